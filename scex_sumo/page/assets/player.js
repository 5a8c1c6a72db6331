// Player: time and futures of a page, with keys, and what is saved of it.

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
    "help-open": () => byId("help").showModal(),
    "save-png": () => canvas.toBlob((blob) => save(blob, nameOf("png"))), "save-webm": film,
  };
  for (const [name, act] of Object.entries(clicks)) byId(name).onclick = () => act();
  Object.assign(byId("time"), { max: last, oninput: ({ target }) => state.seek(Number(target.value)) });
  byId("future").onchange = ({ target: { value } }) => state.show(value === "" ? -1 : clamp(Math.round(value), 0, run.futures - 1));
  for (const box of all("[id^=show]")) box.onchange = () => state.change({}, "view");
  for (const button of all("[data-copy]")) button.onclick = () => copy(button.dataset.copy);

  const moves = {
    arrowleft: () => state.seek(Math.round(state.step) - 1), arrowright: () => state.seek(Math.round(state.step) + 1),
  };
  for (const element of all("[data-key]")) moves[element.dataset.key] = () => element.click();
  document.onkeydown = (event) => {
    const { key, target, ctrlKey, metaKey, altKey } = event, act = moves[key.toLowerCase()];
    const isText = target.matches("input[type=search]"), isTyping = key === " " ? isText : isText || target.matches("input:not([type=checkbox]), select") && key !== "Escape";
    if (!act || isTyping || ctrlKey || metaKey || altKey || byId("help").open) return;
    event.preventDefault();
    act();
  };
  document.onkeyup = (event) => { // Space plays, also on a button
    if (event.key === " " && event.target.matches("button, [type=checkbox]") && !byId("help").open) event.preventDefault();
  };

  return () => {
    byId("time").value = state.step;
    tell(byId("clock"), seconds(state.step));
    tell(byId("play"), state.playing ? "❚❚" : "▶");
    byId("all").classList.toggle("on", state.future < 0);
    tell(byId("shown"), `shown: ${state.future < 0 ? "all futures of the stress test" : `${run.isHuman(state.future) ? "" : "stress test, "}${run.nameOf(state.future)}`}`);
    if (document.activeElement !== byId("future")) byId("future").value = state.future < 0 ? "" : run.number(state.future);
  };
}
