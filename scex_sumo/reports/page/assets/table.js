// Tables: sorted by a click on a head, rows that lead somewhere.

const FORMATS = {
  text: String, count: String, percent, seconds: (s) => `${short(s, 1)} s`, metres: (m) => `${short(m, 1)} m`,
  real: (value) => short(value, 3), times: (value) => `× ${value}`,
};

// A table is {columns: [{title, as, none, hint, words, down}], rows: [{cells, ...}]}: `as` is one of the
// formats, `none` stands for what is missing, `down` begins with the largest.
function makeTable(host, { columns, rows }, { onRow, isChosen = () => false, first = 10 } = {}) {
  let by = -1, down = false, whole = false;
  const text = ({ as = "text", none = "–" }, value) => isMissing(value) ? none : FORMATS[as](value);

  function draw() {
    const sorted = by < 0 ? rows : [...rows].sort((a, b) => (down ? -1 : 1) * compare(a.cells[by], b.cells[by]));
    const head = make("tr", {}, ...columns.map(({ title, words, hint = "sort" }, i) => {
      const mark = i === by ? (down ? " ↓" : " ↑") : "";
      const button = make("button", { textContent: title + mark, title: hint, onclick: () => sortBy(i) });
      return make(words ? "th.words" : "th", {}, button);
    }));
    const body = make("tbody", {}, ...(whole ? sorted : sorted.slice(0, first)).map((row) => {
      const line = make(onRow ? "tr.go" : "tr", {}, ...columns.map((column, i) => make(column.words ? "td.words" : "td", text(column, row.cells[i]))));
      line.classList.toggle("chosen", Boolean(isChosen(row)));
      return onRow ? onPress(line, () => onRow(row)) : line;
    }));
    const table = make("div.scroll", {}, make("table", {}, make("thead", {}, head), body));
    const more = make("button", { textContent: whole ? "fewer" : `all ${rows.length}`, onclick: () => { whole = !whole; draw(); } });
    const top = host.firstElementChild ? host.firstElementChild.scrollTop : 0;
    host.replaceChildren(table, ...(rows.length > first ? [more] : []));
    table.scrollTop = top;
  }

  function sortBy(column) {
    down = by === column ? !down : columns[column].down;
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
  return typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : a - b;
}
