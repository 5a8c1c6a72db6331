// Cases: cards that play, filtered by what they are; those that are marked are saved as a list of names.

unpack(byId("data").textContent).then(({ info }) => {
  showTables(info.tables);
  const cards = all("article"), filters = all("[data-filter]"), marked = new Set();
  cards.forEach((card, i) => {
    const { name, outlines } = info.cards[i], mark = card.querySelector("[data-mark]");
    if (outlines) makeStage(card, info.cards[i]);
    if (mark) mark.onchange = () => {
      marked[mark.checked ? "add" : "delete"](name);
      show();
    };
  });

  function show() {
    const isWanted = ({ about }) => filters.every(({ dataset, value }) => !value || about[dataset.filter] === value);
    const seen = cards.filter((card, i) => {
      card.hidden = !isWanted(info.cards[i]);
      return !card.hidden;
    });
    tell(byId("counts"), `${seen.length} of ${cards.length} cases` + (marked.size ? `, ${marked.size} marked` : ""));
    if (byId("save")) tell(byId("said"), marked.size ? `scex-sumo test SUITE --cases ${[...marked].join(",")} --under-test MODEL` : "");
  }

  // A cell of the table asks for its cases.
  for (const cell of all("[data-cell]")) cell.onclick = () => {
    const wanted = JSON.parse(cell.dataset.cell);
    for (const filter of filters) filter.value = wanted[filter.dataset.filter] ?? "";
    show();
    byId("cards").scrollIntoView();
  };
  for (const filter of filters) filter.onchange = show;
  if (byId("save")) byId("save").onclick = () => {
    const names = info.cards.filter(({ name }, i) => marked.size ? marked.has(name) : !cards[i].hidden).map(({ name }) => name);
    save(new Blob([names.join("\n") + "\n"], { type: "text/plain" }), "cases.txt");
  };
  show();
});
