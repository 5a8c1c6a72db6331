// Tables: sorted by a click on a head, rows that lead somewhere.

// Columns are {title, text, sort, words, hint}; `text` and `sort` are functions of a row.
function makeTable(host, columns, { onRow, isChosen, first = 12 } = {}) {
  let rows = [], by = -1, down = false, whole = false;
  function draw() {
    const sorted = by < 0 ? rows : [...rows].sort((a, b) => compare(columns[by].sort(a), columns[by].sort(b)) * (down ? -1 : 1));
    const head = make("tr", {}, ...columns.map((column, i) => {
      const mark = i === by ? (down ? " ↓" : " ↑") : "";
      const button = make("button", { textContent: column.title + mark, title: column.hint || "sort", onclick: () => sortBy(i) });
      return make(column.words ? "th.words" : "th", {}, button);
    }));
    const shown = whole ? sorted : sorted.slice(0, first);
    const body = make("tbody", {}, ...shown.map((row) => {
      const cells = columns.map((column) => make(column.words ? "td.words" : "td", { textContent: column.text(row) }));
      const line = make(onRow ? "tr.go" : "tr", { tabIndex: onRow ? 0 : -1 }, ...cells);
      if (isChosen && isChosen(row)) line.classList.add("chosen");
      if (onRow) {
        line.onclick = () => onRow(row);
        line.onkeydown = (event) => { if (event.key === "Enter") onRow(row); };
      }
      return line;
    }));
    const parts = [make("div.scroll", {}, make("table", {}, make("thead", {}, head), body))];
    if (rows.length > first) {
      parts.push(make("button", { textContent: whole ? "fewer" : `all ${rows.length}`, onclick: () => { whole = !whole; draw(); } }));
    }
    const top = host.firstElementChild ? host.firstElementChild.scrollTop : 0;
    host.replaceChildren(...parts);
    parts[0].scrollTop = top;
  }
  function sortBy(column) {
    down = by === column ? !down : false;
    by = column;
    draw();
  }
  return { show(next) { rows = next; draw(); }, draw };
}

function compare(a, b) {
  if (typeof a === "string") return a.localeCompare(b);
  const missing = (value) => value === null || value === undefined || Number.isNaN(value);
  if (missing(a) || missing(b)) return missing(a) - missing(b);
  return a - b;
}
