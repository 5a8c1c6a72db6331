// Tables: sorted by a click on a head, rows that lead somewhere.

// Columns are {title, text, sort, words, hint}; `text` and `sort` are functions of a row.
function makeTable(host, columns, { onRow, isChosen = () => false, first = 10 } = {}) {
  let rows = [], by = null, down = false, whole = false;

  function draw() {
    const order = down ? -1 : 1;
    const sorted = by ? [...rows].sort((a, b) => order * compare(by.sort(a), by.sort(b))) : rows;
    const head = make("tr", {}, ...columns.map((column) => {
      const mark = column === by ? (down ? " ↓" : " ↑") : "";
      const button = make("button", { textContent: column.title + mark, title: column.hint || "sort", onclick: () => sortBy(column) });
      return make(column.words ? "th.words" : "th", {}, button);
    }));
    const body = make("tbody", {}, ...(whole ? sorted : sorted.slice(0, first)).map((row) => {
      const cells = columns.map((column) => make(column.words ? "td.words" : "td", column.text(row)));
      const line = make(onRow ? "tr.go" : "tr", {}, ...cells);
      line.classList.toggle("chosen", isChosen(row));
      return onRow ? onPress(line, () => onRow(row)) : line;
    }));
    const table = make("div.scroll", {}, make("table", {}, make("thead", {}, head), body));
    const more = make("button", { textContent: whole ? "fewer" : `all ${rows.length}`, onclick: () => { whole = !whole; draw(); } });
    const top = host.firstElementChild ? host.firstElementChild.scrollTop : 0;
    host.replaceChildren(table, ...(rows.length > first ? [more] : []));
    table.scrollTop = top;
  }

  function sortBy(column) {
    down = by === column && !down;
    by = column;
    draw();
  }
  return { show(next) { rows = next; draw(); }, draw };
}

// An element that acts on a click and on the Enter key.
function onPress(element, act) {
  return Object.assign(element, { tabIndex: 0, onclick: act, onkeydown: (event) => { if (event.key === "Enter") act(); } });
}

function compare(a, b) {
  if (isMissing(a) || isMissing(b)) return isMissing(a) - isMissing(b);
  return typeof a === "string" ? a.localeCompare(b) : a - b;
}
