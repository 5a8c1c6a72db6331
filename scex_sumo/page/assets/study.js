// Page of a study: nothing but its tables.

unpack(byId("data").textContent).then(({ info }) => showTables(info.tables));
