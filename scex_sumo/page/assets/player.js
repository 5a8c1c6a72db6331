// Player: time and futures of a page, with keys, and what is saved of it.

const MARKED = ["ttc", "ttc_path", "drac", "pet"]; // metrics whose events stand on the time bar
const PAN_PX = 60;
const REST_S = 1; // at the moment of an event

// Events of a future in their order: its collisions, and the worst moment of each metric if it is critical.
function eventsOf({ info }, state, future) {
  const isEvent = ({ metric, pair, cells, futures }) => pair && futures.includes(future) && (metric < 0 || MARKED.includes(info.metrics[metric].column) && state.isCritical(metric, cells[1]));
  return info.events.rows.filter(isEvent).sort((a, b) => a.step - b.step);
}

function makePlayer(run, state, map) {
  const { info } = run, last = run.frames - 1, canvas = byId("map");
  let isOn = false, isFilmed = false;
  const nameOf = (ending) => `${info.name}${state.future < 0 ? "" : `_${run.nameOf(state.future).replace("future ", "future").replace(" ", "_")}`}.${ending}`;

  // Plays again and again, and rests at the moment of the event; a film that is saved plays once.
  function play() {
    let held = state.step === state.rest ? REST_S : 0;
    if (!isOn) animate((passed) => {
      isOn = state.playing;
      held -= passed;
      if (!isOn || held > 0) return isOn;
      const next = state.step + 10 * passed * Number(byId("speed").value), isThere = !isFilmed && state.step < state.rest && next >= state.rest;
      if (isThere) held = REST_S;
      if (next > (isFilmed ? last : state.end())) state.change(isFilmed ? { step: last, playing: false } : { step: 0 });
      else state.change({ step: isThere ? state.rest : next });
      return true;
    });
    isOn = true;
  }

  function film() {
    const type = "video/webm", recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: type, videoBitsPerSecond: 6e6 });
    const end = setInterval(() => {
      if (state.playing) return;
      clearInterval(end);
      isFilmed = false;
      recorder.stop();
    }, 300);
    recorder.ondataavailable = ({ data }) => save(new Blob([data], { type }), nameOf("webm"));
    isFilmed = true;
    state.change({ step: 0, playing: true });
    recorder.start();
  }

  function copy(command) {
    const folder = run.isHuman(state.future) ? `${info.folder}/reference` : info.folder;
    const words = command.replace(`'${info.folder}'`, `'${folder}'`).replace("FUTURE", run.number(Math.max(state.future, 0)));
    navigator.clipboard.writeText(words).then(() => say(`copied: ${words}`), () => say(words));
  }

  const clicks = {
    play: () => state.change({ playing: !state.playing }), all: () => state.change({ future: -1 }), previous: () => state.nextFuture(true), next: () => state.nextFuture(false),
    fit: map.fit, "zoom-in": () => map.zoom(1.3), "zoom-out": () => map.zoom(1 / 1.3),
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

  const go = ({ pair, step }) => state.change({ pair, step, rest: step, playing: false });

  function nextEvent() { // in a circle
    const events = eventsOf(run, state, state.future), next = events.find(({ step }) => step > Math.round(state.step)) ?? events[0];
    if (next) go(next);
  }

  function drawMarks() { // events of both futures on the time bar
    const markOf = (row) => {
      const { metric, pair, step, cells } = row, { name, unit } = info.metrics[metric] ?? { name: "collision at", unit: "m/s" };
      const words = `${pair.map(run.id).join(" and ")}: ${name} ${short(cells[1])} ${unit}, ${seconds(step)}`;
      const mark = make(`button.${metric < 0 ? "hit" : "near"}`, { title: words, ariaLabel: words, onclick: () => go(row) });
      mark.style.left = `calc(${100 * step / last}% + ${8 - 16 * step / last}px)`;
      return mark;
    };
    byId("marks").replaceChildren(...eventsOf(run, state, state.future).map(markOf));
  }

  return (isNew) => {
    if (isNew) drawMarks();
    if (state.playing) play();
    byId("time").value = state.step;
    tell(byId("clock"), seconds(state.step));
    tell(byId("play"), state.playing ? "❚❚" : "▶");
    byId("all").classList.toggle("on", state.future < 0);
    if (document.activeElement !== byId("future")) byId("future").value = state.future < 0 ? "" : run.number(state.future);
  };
}
