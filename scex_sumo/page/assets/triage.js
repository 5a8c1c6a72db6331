// Triage: verdicts and notes on the cards of a ranking, by keys; kept by the browser, saved and read as CSV.

unpack(byId("data").textContent).then(({ info }) => {
  const { verdicts, rows } = info, store = `scex-sumo triage ${info.name}`, table = info.tables["all-encounters"];
  const fields = ["recording", "case", "track_id", "other_id", "first_s", "last_s", "time_s"], names = [...fields, "verdict", "note"];
  const cards = all("article"), last = table.columns.length - 1, shown = makeTable(byId("all-encounters"), table);
  const pairOf = (row) => [row.recording, row.case, ...[row.track_id, row.other_id].map(String).sort()].join("\n");

  cards.forEach((card, i) => {
    const row = rows[info.cards[i].row];
    makeStage(card, info.cards[i]);
    for (const button of all("[data-verdict]", card)) button.onclick = () => judge(row, button.dataset.verdict);
    card.querySelector(".note").oninput = ({ target }) => change(row, { note: target.value });
  });

  let span = null; // of a recording, on its time line
  const isInside = (row) => !span || row.recording === span.recording && row.first_s <= span.last && row.last_s >= span.first;
  makeTimelines((chosen) => {
    span = chosen;
    show();
  });

  function judge(row, verdict) { // the same one again takes it back
    change(row, { verdict: row.verdict === verdict ? null : verdict });
  }

  function change(row, what) {
    Object.assign(row, what);
    keep();
    show();
  }

  function keep() {
    try { localStorage.setItem(store, JSON.stringify(rows.filter(isJudged))); } catch { say("this browser keeps nothing: save the verdicts"); }
  }

  function isJudged({ verdict, note }) {
    return Boolean(verdict || note);
  }

  function show() {
    cards.forEach((card, i) => {
      const row = rows[info.cards[i].row], note = card.querySelector(".note");
      for (const button of all("[data-verdict]", card)) {
        button.classList.toggle("on", button.dataset.verdict === row.verdict);
        button.ariaPressed = button.dataset.verdict === row.verdict;
      }
      card.classList.toggle("judged", Boolean(row.verdict));
      if (document.activeElement !== note) note.value = row.note || "";
    });
    table.rows.forEach((line, i) => { line.cells[last] = rows[i].verdict; });
    shown.show(table.rows.filter((_, i) => isInside(rows[i])));
    const counts = verdicts.map((verdict) => `${rows.filter((row) => row.verdict === verdict).length} ${verdict}`);
    tell(byId("counts"), counts.join(", "));
  }

  // Verdicts of a file, or of an earlier visit, to the encounters whose pair and time they are of.
  function take(found) {
    const given = new Map();
    for (const one of found) given.set(pairOf(one), [...(given.get(pairOf(one)) || []), one]);
    let count = 0;
    for (const row of rows) {
      const one = (given.get(pairOf(row)) || []).findLast(({ time_s }) => row.first_s <= time_s && time_s <= row.last_s);
      if (!one || one.verdict && !verdicts.includes(one.verdict)) continue;
      Object.assign(row, { verdict: one.verdict || null, note: one.note || null });
      count += 1;
    }
    return count;
  }

  const quoted = (value) => /[",\r\n]/.test(value) ? `"${value.replaceAll("\"", "\"\"")}"` : value;
  const lineOf = (values) => values.map((value) => quoted(isMissing(value) ? "" : String(value))).join(",");

  function rowsOf(text) { // of CSV: quoted fields may hold commas, quotes and ends of lines
    const lines = [[]], pattern = /("(?:[^"]|"")*"|[^,\r\n]*)(,|\r?\n|$)/g;
    for (const [whole, field, end] of text.replace(/^\ufeff/, "").matchAll(pattern)) {
      if (!whole) break;
      lines.at(-1).push(field.startsWith("\"") ? field.slice(1, -1).replaceAll("\"\"", "\"") : field);
      if (end !== ",") lines.push([]);
    }
    const [heads, ...rest] = lines.filter((line) => line.length > 1);
    return { heads, found: rest.map((line) => Object.fromEntries(heads.map((head, k) => [head, line[k] ?? ""]))) };
  }

  async function read(file) {
    if (!file) return;
    const { heads = [], found } = rowsOf(await file.text()), missing = names.filter((name) => name !== "first_s" && name !== "last_s" && !heads.includes(name));
    if (missing.length) return say(`${file.name}: no column ${missing[0]}; it is no file of verdicts`);
    const count = take(found);
    keep();
    show();
    say(`${count} verdicts of ${found.length} in ${file.name} are of encounters here`);
  }

  byId("save").onclick = () => {
    const lines = [names, ...rows.filter(isJudged).map((row) => names.map((name) => row[name]))];
    save(new Blob([lines.map(lineOf).join("\n") + "\n"], { type: "text/csv" }), "triage.csv");
  };
  byId("read").onchange = ({ target }) => read(target.files[0]);
  document.ondragover = (event) => event.preventDefault();
  document.ondrop = (event) => {
    event.preventDefault();
    read(event.dataTransfer.files[0]);
  };

  function go(by) {
    const at = cards.indexOf(document.activeElement.closest("article")), next = cards[Math.min(Math.max(at + by, 0), cards.length - 1)];
    if (next) next.focus();
  }

  document.onkeydown = (event) => {
    const { key, target, ctrlKey, metaKey, altKey } = event, at = cards.indexOf(target.closest("article"));
    if (target.matches("input")) {
      if (key === "Escape" || key === "Enter") target.closest("article")?.focus();
      return;
    }
    if (ctrlKey || metaKey || altKey) return;
    const row = at < 0 ? null : rows[info.cards[at].row], verdict = verdicts[Number(key) - 1];
    const acts = { j: () => go(1), k: () => go(-1), n: () => cards[at]?.querySelector(".note").focus(), 0: () => row && change(row, { verdict: null }) };
    const act = verdict ? () => row ? judge(row, verdict) : say("choose a card first: J") : acts[key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  };

  try { take(JSON.parse(localStorage.getItem(store)) || []); } catch { say("verdicts of an earlier visit cannot be read"); }
  show();
});
