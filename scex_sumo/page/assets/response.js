// Critical responses: a map of what one does against how late another one responds, and P with people of the sliders.

// Normal tail P(Z > z), to 1e-7 of its value (Numerical Recipes, erfcc).
function tailOf(z) {
  const x = Math.abs(z) / Math.SQRT2, t = 1 / (1 + x / 2);
  const terms = [-1.26551223, 1.00002368, 0.37409196, 0.09678418, -0.18628806, 0.27886807, -1.13520398, 1.48851587, -0.82215223, 0.17087277];
  const tail = t / 2 * Math.exp(-x * x + terms.reduceRight((value, term) => value * t + term));
  return z > 0 ? tail : 1 - tail;
}

function quantileOf(share) {
  let low = -9, high = 9;
  while (high - low > 1e-9) [low, high] = tailOf((low + high) / 2) > 1 - share ? [(low + high) / 2, high] : [low, (low + high) / 2];
  return low;
}

// How likely one responds to an action later than a time, as `People.later` of people.py: (action, time gap, time, share of the gap left).
function laterOf(people) {
  const { response_s: medians, response_spread: spread, glance_s: glance, glance_spread: lasting, step_s: step, last_s: last } = people;
  const draws = Array.from({ length: people.draws }, (_, k) => Math.exp(spread * quantileOf((k + 0.5) / people.draws)));
  const mean = glance * Math.exp(lasting ** 2 / 2), still = Array.from({ length: Math.round(last / step) + 1 }, (_, k) => {
    const time = Math.max(k * step, 1e-9), z = Math.log(time / glance) / lasting;
    return tailOf(z - lasting) - time / mean * tailOf(z); // of glances away that go on
  });
  const stillAt = (time) => {
    const at = clamp(time / step, 0, still.length - 1), low = Math.min(Math.floor(at), still.length - 2);
    return time > 0 ? still[low] + (at - low) * (still[low + 1] - still[low]) : 1;
  };
  return (action, gap, response, left = 1) => {
    if (response === null || response < 0) return response === null ? 0 : 1; // no contact; contact at once
    const near = clamp((gap ?? Infinity) / people.reference_gap_s, people.closest, 1), median = medians[action] * near ** people.close_response;
    const time = clamp(response, 1e-6, last), away = people.away_share * near ** people.close_away;
    const late = sum(draws.map((draw) => stillAt(time - median * draw))) / draws.length;
    return ((1 - away) * tailOf(Math.log(time / median) / spread) + away * late) * clamp(left, 0, 1) ** people.growth;
  };
}

// P of a pair by the value of the action, as `probabilities` of people.py: [later, what it adds to P].
function partsOf(people, { action, gap, often, responses, left }) {
  const kind = people.actions.findIndex(({ name }) => name === action), late = laterOf(people);
  const later = responses.map((line, i) => sum(line.map((response, k) => people.shares[k] * late(kind, gap, response, left[i][k]))));
  return later.map((here, i) => {
    const after = often[i + 1] ?? 0, next = later[i + 1] ?? here, mean = often[i] === after ? after : (often[i] - after) / Math.log(often[i] / after);
    return [here, people.actions[kind].smooth ? often[i] * here - after * next + (next - here) * mean : (often[i] - after) * here];
  });
}
const responseProbability = (people, pair) => sum(partsOf(people, pair).map(([, part]) => part));

const MAX_SHOWN_S = 4.5; // response time

function responseCard(run, state, { people: counted, pairs }, jump, road) {
  const canvas = byId("response-map"), sliders = ["people-median", "people-away", "people-late"].map(byId), figures = all("#people output");
  const columns = [{ title: "pair" }, { title: "action", kind: "words" }, { title: "collides about", kind: "names" }, { title: "as counted", kind: "names" }];
  const vehicle = (track) => run.info.track_ids.indexOf(track), vehiclesOf = ({ other_id: other, track_id: track }) => [vehicle(other), vehicle(track)];
  const play = actingStage(run, road, byId("acting"));
  let people = counted, chosen = pairs[0], level = 0, late = 0, axis = {}, parts;
  const actionOf = ({ action }) => counted.actions.find(({ name }) => name === action), kindOf = (pair) => counted.actions.indexOf(actionOf(pair));
  const rows = () => pairs.map((pair) => ({
    pair,
    cells: [`${pair.other_id} → ${pair.track_id}`, `${pair.track_id} ${pair.action}${pair.doubt ? ` (doubtful: ${pair.doubt})` : ""}`, onceIn(responseProbability(people, pair)), onceIn(pair.probability)],
  }));
  const table = makeTable(byId("response-table"), { columns, rows: rows() }, { onRow: ({ pair }) => open(pair), isChosen: ({ pair }) => pair === chosen });

  function choose(pair) {
    chosen = pair;
    level = actionOf(pair).values.indexOf(pair.value);
    late = lateOf(pair.responses[level][1]);
    table.choose();
    act();
    list();
  }

  // The median of too late responses, as `too_late` of answer.py; without contact that of all.
  function lateOf(critical) {
    const median = people.response_s[kindOf(chosen)];
    return Math.min(critical === null ? median : Math.max(critical + 0.2, median), MAX_SHOWN_S);
  }

  function act() { // plays the point of the map
    const vehicles = vehiclesOf({ other_id: chosen.track_id, track_id: chosen.other_id }), motion = actedBy(chosen, level, late, people, vehicles.map((v) => run.info.sizes[v]));
    const { track_id: one, other_id: other } = chosen, { values, unit } = actionOf(chosen), after = (motion.poses.length - 1) / 10;
    play(vehicles, motion);
    const ends = motion.speed === null ? "no contact" : `contact after ${after.toFixed(1)} s, at ${motion.speed.toFixed(0)} m/s`;
    tell(byId("acting-said"), `Plays: ${one} ${chosen.action}, ${values[level]} ${unit}; ${other} brakes ${late.toFixed(1)} s after that shows: ${ends}.`);
    draw();
  }

  function open(pair) { // here, and on the map
    choose(pair);
    const both = vehiclesOf(pair), met = run.info.encounters.rows.filter((row) => pairKey(row.pair) === pairKey(both));
    const row = met.find(({ human }) => human) ?? met[0];
    if (row) jump(row);
    else state.change({ pair: both, future: -1, step: 0, playing: false });
  }

  function draw() {
    const { values, unit, words, smooth } = actionOf(chosen), kind = kindOf(chosen), isLater = laterOf(people), { often, responses } = chosen;
    parts = partsOf(people, chosen);
    sliders[0].value = people.response_s[kind];
    sliders[1].value = people.away_share;
    sliders[2].value = late;
    [`${short(people.response_s[kind])} s`, percent(people.away_share), `${short(late, 1)} s`].forEach((said, i) => tell(figures[i], said));
    const pen = sharp(canvas), { paint, write, width, height } = pen, [left, right, top, base] = [30, width - 64, 46, height - 30];
    const highest = Math.max(...responses.flat()), most = clamp(1.25 * highest, 3, MAX_SHOWN_S), least = values[0], largest = values.at(-1);
    if (!width) return;
    axis = { most, top, base, right };
    const toX = (value) => left + (value - least) / (largest - least) * (right - left), toY = (time) => base - clamp(time ?? most, 0, most) / most * (base - top);
    counted.decelerations.forEach((_, k) => {
      const line = values.flatMap((value, i) => [value, ...(smooth || i > 8 ? [] : [values[i + 1]])].map((x) => [toX(x), toY(responses[i][k])])), dash = [[2, 3], [], [6, 3]][k];
      paint([...line, [right, top], [left, top]], { fill: "critical", alpha: 0.12 });
      paint(line, { stroke: "critical", dash });
    });
    const box = (a, b, y, bottom, style) => paint([[a, y], [b, y], [b, bottom], [a, bottom]], style);
    values.slice(0, -1).forEach((value, i) => { // frequencies of the action, tenfold by a ninth of the height
      const share = (often[i] - often[i + 1]) / (values[i + 1] - value), high = share > 0 ? clamp(9 + Math.log10(share), 0, 9) / 9 * 34 : 0;
      box(toX(value), toX(values[i + 1]) - 1, 40 - high, 40, { fill: "likely", alpha: 0.45 });
    });
    const times = Array.from({ length: 81 }, (_, i) => i / 80 * most), shares = times.map((time) => isLater(kind, chosen.gap, time));
    const dense = shares.map((share, i) => share - (shares[i + 1] ?? share)), peak = Math.max(...dense);
    paint([[right + 6, base], ...dense.map((share, i) => [right + 6 + share / peak * 54, toY(times[i])]), [right + 6, top]], { fill: "likely", alpha: 0.45 });
    paint([[left, toY(counted.careful_s)], [right, toY(counted.careful_s)]], { stroke: "soft", dash: [1, 3], width: 1 });
    write("careful driver", right - 3, toY(counted.careful_s) - 3, { align: "right", halo: "card" });
    paint([[left, top], [left, base], [right, base]], { stroke: "line", width: 1 });
    for (const value of values.filter((_, i) => i % 3 === 0)) write(short(value, 1), toX(value), base + 12);
    for (let time = 0; time <= most; time++) write(`${time} s`, left - 4, toY(time) + (time ? 4 : 0), { align: "right" });
    write(`${chosen.track_id} ${chosen.action}, ${unit}`, (left + right) / 2, height - 4);
    write("how often, by tens", left + 2, 10, { align: "left", halo: "card" });
    write("how late", right + 6, top - 4, { align: "left" });
    const at = toX(values[level]);
    paint([[at, 6], [at, base]], { stroke: "picked" });
    paint([[left, toY(late)], [right, toY(late)]], { stroke: "picked", width: 1, dash: [1, 3] });
    for (const response of responses[level]) paint(circle([at, toY(response)], 2.5), { fill: "picked" });
    paint(circle([at, toY(late)], 6), { stroke: "picked", fill: "card", width: 2.5 });
    const said = saidOf(words, smooth);
    tell(byId("response-said"), said);
    for (const [name, value] of Object.entries({ valuemin: least, valuemax: largest, valuenow: values[level], valuetext: said })) canvas.setAttribute(`aria-${name}`, value);
  }

  function list() { // the map as text
    const { values, unit } = actionOf(chosen), { responses } = chosen, asText = (time) => time === null ? "never" : time < 0 ? "always" : `${short(time, 2)} s`;
    const limits = counted.decelerations.map((braking) => `contact if later, at ${braking} m/s²`), total = sum(parts.map(([, part]) => part));
    const heads = [unit, actionOf(chosen).smooth ? "at least so" : "up to the next", ...limits, "responds later", "share of P"];
    tabulate(canvas, `${chosen.track_id} ${chosen.action}, ${chosen.other_id} responds`, heads, values.map((value, i) => (
      [value, onceIn(oftenAt(i)), ...responses[i].map(asText), onceIn(parts[i][0]), percent(parts[i][1] / total)])));
  }

  // How often one acts with at least a value; where the frequency jumps with the time that is left: from it to the next one.
  const oftenAt = (i) => chosen.often[i] - (actionOf(chosen).smooth ? 0 : chosen.often[i + 1] ?? 0);

  function saidOf(words, smooth) { // of the value under the cursor
    const value = actionOf(chosen).values[level], [later, part] = parts[level], total = sum(parts.map(([, each]) => each)), { track_id: one, other_id: other } = chosen;
    const { values, unit } = actionOf(chosen), most = values[level + 1] ? `to ${values[level + 1]} ${unit}` : `${unit} or more`;
    const does = smooth ? words.replace("{}", value) : `${chosen.action} with ${value} ${most}`, by = chosen.responses[level];
    const share = later < 0.6 ? `one of ${oneDigit(1 / later)}` : "as most do";
    const limits = by.map((time, k) => `${time === null ? "never" : time < 0 ? "0 s" : `${short(time, 1)} s`} (${counted.decelerations[k]} m/s²)`).join(", ");
    const late = by.every((time) => time === null) ? "No contact." : by.every((time) => time < 0) && by[0] !== null ? `${other} cannot brake in time.`
      : `Contact if ${other} responds later than: ${limits}: ${later > 1e-9 ? share : "nobody"}.`;
    return `${one} ${does}: ${onceIn(oftenAt(level))}. ${late} ${(100 * part / total || 0).toFixed(0)} % of P. A collision about ${onceIn(total)}; as counted ${onceIn(chosen.probability)}.`;
  }

  function change(next) { // takes other people
    people = next;
    table.show(rows());
    draw();
    list();
    announce(`${chosen.other_id} and ${chosen.track_id} collide about ${onceIn(responseProbability(people, chosen))}`);
  }

  function move(to, time = late) {
    level = clamp(to, 0, chosen.often.length - 1);
    late = clamp(time, 0, MAX_SHOWN_S);
    act();
  }
  sliders[0].oninput = () => {
    const factor = Number(sliders[0].value) / counted.response_s[kindOf(chosen)];
    change({ ...people, response_s: counted.response_s.map((time) => time * factor) });
  };
  sliders[1].oninput = () => change({ ...people, away_share: Number(sliders[1].value) });
  sliders[2].oninput = () => move(level, Number(sliders[2].value));
  byId("own-people").onclick = () => change(counted);
  canvas.onpointerdown = canvas.onpointermove = ({ offsetX, offsetY, buttons, type }) => {
    if (!buttons && type === "pointermove") return;
    const { values } = actionOf(chosen), value = values[0] + (offsetX - 30) / (axis.right - 30) * (values.at(-1) - values[0]);
    move(values.map((each, i) => [Math.abs(each - value), i]).sort(([a], [b]) => a - b)[0][1], (axis.base - offsetY) / (axis.base - axis.top) * axis.most);
  };
  canvas.onkeydown = (event) => {
    const [across, up] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key] ?? [];
    if (across === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    move(level + across, late + up);
  };
  choose(chosen);
  return {
    draw,
    follow() { // the pair that is shown
      const found = state.pair && pairs.find((pair) => pairKey(vehiclesOf(pair)) === pairKey(state.pair));
      if (found && pairKey(vehiclesOf(found)) !== pairKey(vehiclesOf(chosen))) choose(found);
    },
  };
}
