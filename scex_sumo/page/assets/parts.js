// Parts of a report that follow from its data: legend, charts, choices, commands.

function fillReport({ info }) {
  const { metrics, models, colors } = info, titled = ({ name, unit }) => name + (unit && ` [${unit}]`);
  const entry = (kind, ...words) => make("div", {}, make(kind), ...words), quoted = `'${info.folder.replaceAll("'", "'\\''")}'`;

  byId("legend").append( // the only one: bodies by model, lines by what they show
    ...models.map((model, m) => {
      const body = make("i.body");
      body.style.background = colors[m];
      body.textContent = initials(model);
      return make("div", {}, body, model);
    }),
    entry("i.line.drawn", "stress test"), ...(info.human ? [entry("i.line.dash.likely", "human-like")] : []),
    ...(info.has_recorded ? [entry("i.line.dash.recorded", "recorded")] : []), entry("i.line.critical", "critical"),
    entry("i.line.picked", "shown future"),
  );
  byId("charts").append(...metrics.map((metric, m) => {
    const limit = make("input", { type: "number", step: "any", placeholder: " ", title: "Threshold", ariaLabel: `Threshold of ${titled(metric)}` });
    const words = [
      ...(metric.recorded === null ? [] : [`recorded ${short(metric.recorded)} ${metric.unit}`]),
      ...(metric.defined < info.futures ? [`defined in ${metric.defined} of ${info.futures} futures`] : []),
    ];
    const head = make("header", {}, make("span", titled(metric)), make("span", {}, make("b.drawn"), " ", make("b.likely"), ` ${metric.sign} `, limit));
    const canvas = make("canvas", { ariaLabel: `Distribution of ${titled(metric)}`, hidden: !metric.ticks.length });
    const chart = make("div.chart", { hidden: metric.mean }, head, canvas, make("p.soft", words.join(", ")));
    chart.dataset.metric = m;
    return chart;
  }));
  const events = new Set(info.events.rows.map(({ metric }) => metric)), names = ["collision", ...metrics.map(({ name, mean }) => name + (mean ? " (mean)" : ""))];
  byId("focus").append(...names.map((name, i) => make("option", { textContent: name, value: i - 1 })).filter((_, i) => events.has(i - 1)));
  const commands = { "open in sumo-gui": `scex-sumo view ${quoted} --future FUTURE`, "export future": `scex-sumo export ${quoted} --future FUTURE --to fcd`, "run again": info.command };
  byId("copies").append(...Object.entries(commands).filter(([, text]) => text).map(([name, text]) => {
    const button = make("button", `copy: ${name}`);
    button.dataset.copy = text;
    return button;
  }));
}
