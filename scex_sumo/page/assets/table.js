// Tables: sorted by a click on a head, rows that lead somewhere.

const FORMATS = {
  text: String, percent, percent2: (share) => `${(100 * share).toFixed(2)} %`, seconds: (s) => `${short(s, 1)} s`, metres: (m) => `${short(m, 1)} m`,
  real: (value) => short(value, 3), tenths: (value) => short(value, 1), often: onceIn, times: (value) => `× ${value}`,
};

// A table is {columns: [{title, as, none, hint, kind, down}], rows: [{cells, ...}]}: `as` is one of the
// formats, `said` of a row has the words of some cells, `none` stands for what is missing, `down` begins with the largest, `kind` is words or names, `foot` is a last line; `mark` may dress up a cell.
function makeTable(host, { columns, rows, foot }, { onRow, isChosen = () => false, mark = () => {}, onSort = () => {} } = {}) {
  let by = -1, isDown = false, lines = [];
  const cellsOf = (tag, fill) => columns.map((column, i) => fill(make(column.kind ? `${tag}.${column.kind}` : tag), column, i));

  function show(next = rows) {
    rows = next;
    const sorted = by < 0 ? rows : [...rows].sort((a, b) => compare(a.cells[by], b.cells[by], isDown ? -1 : 1));
    const head = cellsOf("th", (cell, { title, hint = "sort" }, i) => {
      cell.append(make("button", { textContent: title + (i === by ? (isDown ? " ↓" : " ↑") : ""), title: hint, onclick: () => sortBy(i) }));
      return cell;
    });
    lines = sorted.map((row) => {
      const line = make("tr", { row }, ...cellsOf("td", (cell, { as = "text", none = "–" }, i) => {
        cell.textContent = row.said?.[i] ?? (isMissing(row.cells[i]) ? none : FORMATS[as](row.cells[i]));
        mark(cell, row, i);
        return cell;
      }));
      return onRow ? onPress(line, () => onRow(row)) : line;
    });
    const last = foot ? [make("tr", {}, ...cellsOf("td", (cell, _, i) => Object.assign(cell, { textContent: foot[i] })))] : [];
    host.replaceChildren(make("table", {}, make("thead", {}, make("tr", {}, ...head)), make("tbody", {}, ...lines), make("tfoot", {}, ...last)));
    choose();
  }

  function choose() { // marks the rows that are chosen now
    for (const line of lines) line.classList.toggle("chosen", isChosen(line.row));
  }

  function sortBy(column, down = by === column ? !isDown : Boolean(columns[column] && columns[column].down)) {
    [by, isDown] = [columns[column] ? column : -1, down];
    show();
    onSort();
  }
  show();
  return { show, choose, sortBy, columns, order: () => by < 0 ? "" : `${by}${isDown ? "d" : "u"}` };
}

function showTables(tables) {
  Object.entries(tables).forEach(([id, table]) => makeTable(byId(id), table));
  explain(document.body);
}

// An element that acts on a click and on the Enter key.
function onPress(element, act) {
  element.classList.add("go");
  return Object.assign(element, { tabIndex: 0, onclick: act, onkeydown: (event) => { if (event.key === "Enter") act(); } });
}

function compare(a, b, sign) { // what is missing comes last
  if (isMissing(a) || isMissing(b)) return isMissing(a) - isMissing(b);
  return sign * (typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : a - b);
}
