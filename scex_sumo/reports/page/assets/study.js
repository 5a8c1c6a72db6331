// Page of a study: its tables.

unpack(byId("data").textContent).then(({ info }) => {
  for (const [id, table] of Object.entries(info.tables)) makeTable(byId(id), table);
});
