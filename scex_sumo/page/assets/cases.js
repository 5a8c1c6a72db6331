// Cases: cards that play, filtered by what they are; those that are marked have a command.

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
    tell(byId("said"), marked.size ? `scex-sumo test SUITE --cases ${[...marked].join(",")} --under-test MODEL` : "");
  }

  for (const filter of filters) filter.onchange = show;
  show();
});
