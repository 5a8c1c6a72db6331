// Player: time and futures of a page, with keys, and what is saved of it.

const MARKED = ["ttc", "ttc_path", "drac", "pet"]; // metrics whose events stand on the time bar
const PAN_PX = 60;

// Events of a future in their order: its collisions, and the worst moment of each metric if it is critical.
function eventsOf({ info }, state, future) {
  const isEvent = ({ metric, pair, cells, futures }) => pair && futures.includes(future) && (metric < 0 || MARKED.includes(info.metrics[metric].column) && state.isCritical(metric, cells[1]));
  return info.events.rows.filter(isEvent).sort((a, b) => a.step - b.step);
}

function makePlayer(run, state, map) {
  const { info } = run, last = run.frames - 1, canvas = byId("map");
  const nameOf = (ending) => `${info.name}${state.future < 0 ? "" : `_${run.nameOf(state.future).replace("future ", "future").replace(" ", "_")}`}.${ending}`;

  function play() {
    let before = performance.now();
    const on = (now) => {
      if (!state.playing) return;
      const step = Math.min(state.step + Math.max(now - before, 0) / 100 * Number(byId("speed").value), last);
      before = now;
      state.change({ step, playing: step < last });
      requestAnimationFrame(on);
    };
    state.change({ playing: !state.playing, step: !state.playing && state.step >= last ? 0 : state.step });
    requestAnimationFrame(on);
  }

  function film() {
    const type = "video/webm", recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: type, videoBitsPerSecond: 6e6 });
    const end = setInterval(() => {
      if (state.playing) return;
      clearInterval(end);
      recorder.stop();
    }, 300);
    recorder.ondataavailable = ({ data }) => save(new Blob([data], { type }), nameOf("webm"));
    state.change({ step: 0, playing: false });
    recorder.start();
    play();
  }

  function copy(command) {
    const folder = run.isHuman(state.future) ? `${info.folder}/reference` : info.folder;
    const words = command.replace(`'${info.folder}'`, `'${folder}'`).replace("FUTURE", run.number(Math.max(state.future, 0)));
    navigator.clipboard.writeText(words).then(() => say(`copied: ${words}`), () => say(words));
  }

  const clicks = {
    play, all: () => state.change({ future: -1 }), previous: () => state.nextFuture(true), next: () => state.nextFuture(false),
    fit: map.fit, "zoom-in": () => map.zoom(1.3), "zoom-out": () => map.zoom(1 / 1.3),
    pin: () => state.change({ beside: state.beside === state.future ? -1 : state.future }),
    large: () => {
      const isLarge = byId("report").classList.toggle("large");
      byId("large").setAttribute("aria-pressed", isLarge);
    },
    "help-open": () => byId("help").showModal(),
    "save-png": () => canvas.toBlob((blob) => save(blob, nameOf("png"))), "save-webm": film,
  };
  for (const [name, act] of Object.entries(clicks)) byId(name).onclick = () => act();
  Object.assign(byId("time"), { max: last, oninput: ({ target }) => state.seek(Number(target.value)) });
  byId("future").onchange = ({ target: { value } }) => state.show(value === "" ? -1 : clamp(Math.round(value), 0, run.futures - 1));
  byId("beside").onchange = ({ target: { value } }) => state.show(run.futureOf(value), {}, "beside");
  for (const box of all("[id^=show]")) box.onchange = () => state.change({}, "view");
  for (const button of all("[data-copy]")) button.onclick = () => copy(button.dataset.copy);

  const moves = {
    arrowleft: () => state.seek(Math.round(state.step) - 1), arrowright: () => state.seek(Math.round(state.step) + 1), e: nextEvent,
  };
  for (const [name, x, y] of [["left", 1, 0], ["right", -1, 0], ["up", 0, 1], ["down", 0, -1]]) moves[`shift arrow${name}`] = () => map.pan(x * PAN_PX, y * PAN_PX);
  for (const element of all("[data-key]")) moves[element.dataset.key] = () => element.click();
  document.onkeydown = (event) => {
    const { key, target, ctrlKey, metaKey, altKey, shiftKey } = event, name = key.toLowerCase(), act = shiftKey && moves[`shift ${name}`] || moves[name];
    const isText = target.matches("input[type=search]"), isTyping = key === " " ? isText : isText || target.matches("input:not([type=checkbox]), select") && key !== "Escape";
    if (!act || isTyping || ctrlKey || metaKey || altKey || byId("help").open) return;
    event.preventDefault();
    act();
  };
  document.onkeyup = (event) => { // Space plays, also on a button
    if (event.key === " " && event.target.matches("button, [type=checkbox]") && !byId("help").open) event.preventDefault();
  };

  const go = ({ pair, step }) => state.change({ pair, step, playing: false });

  function nextEvent() { // in a circle
    const events = eventsOf(run, state, state.future), next = events.find(({ step }) => step > Math.round(state.step)) ?? events[0];
    if (next) go(next);
  }

  function drawMarks() { // events of both futures on the time bar
    const markOf = (row, kind) => {
      const { metric, pair, step, cells } = row, { name, unit } = info.metrics[metric] ?? { name: "collision at", unit: "m/s" };
      const words = `${pair.map(run.id).join(" and ")}: ${name} ${short(cells[1])} ${unit}, ${seconds(step)}`;
      const mark = make(`button.${metric < 0 ? "hit" : "near"}.${kind}`, { title: words, ariaLabel: words, onclick: () => go(row) });
      mark.style.left = `calc(${100 * step / last}% + ${8 - 16 * step / last}px)`;
      return mark;
    };
    byId("marks").replaceChildren(...["future", "beside"].flatMap((kind) => state[kind] < 0 ? [] : eventsOf(run, state, state[kind]).map((row) => markOf(row, kind))));
  }

  return (isNew) => {
    if (isNew) drawMarks();
    byId("time").value = state.step;
    tell(byId("clock"), seconds(state.step));
    tell(byId("play"), state.playing ? "❚❚" : "▶");
    byId("all").classList.toggle("on", state.future < 0);
    tell(byId("shown"), `shown: ${state.future < 0 ? "all futures of the stress test" : `${run.isHuman(state.future) ? "" : "stress test, "}${run.nameOf(state.future)}`}`);
    byId("pin").classList.toggle("on", state.beside >= 0);
    byId("pin").disabled = state.future < 0;
    if (document.activeElement !== byId("beside")) byId("beside").value = run.textOf(state.beside);
    if (document.activeElement !== byId("future")) byId("future").value = state.future < 0 ? "" : run.number(state.future);
  };
}
