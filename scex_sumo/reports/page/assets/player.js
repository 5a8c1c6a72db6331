// Player: time and children of a page, with keys, and what is saved of it.

function makePlayer(run, state, map) {
  const { info } = run;
  const nextChild = (offset) => state.change({ child: state.selected(offset) });
  const nameOf = (ending) => `${info.name}${state.child < 0 ? "" : `_child${state.child}`}.${ending}`;

  // Calls back once per frame with the milliseconds since the one before, as long as that says true.
  function everyFrame(act) {
    let before = performance.now();
    const on = (now) => {
      const goesOn = act(Math.max(now - before, 0));
      before = now;
      if (goesOn) requestAnimationFrame(on);
    };
    requestAnimationFrame(on);
  }

  function play() {
    const last = run.frames - 1;
    state.change({ playing: !state.playing, step: !state.playing && state.step >= last ? 0 : state.step });
    if (!state.playing) return;
    chase();
    everyFrame((milliseconds) => {
      const step = Math.min(state.step + milliseconds / 100 * Number(byId("speed").value), last);
      if (state.playing) state.change({ step, playing: step < last });
      return state.playing;
    });
  }

  let isChasing = false;
  function chase() {
    if (isChasing || !state.pair) return;
    isChasing = true;
    everyFrame(() => {
      isChasing = Boolean(state.pair) && byId("follow").checked && (map.pursue() || state.playing);
      state.change({}, "view");
      return isChasing;
    });
  }

  function film() {
    const parts = [], type = "video/webm", recorder = new MediaRecorder(map.canvas.captureStream(30), { mimeType: type, videoBitsPerSecond: 6e6 });
    recorder.ondataavailable = (event) => parts.push(event.data);
    recorder.onstop = () => save(new Blob(parts, { type }), nameOf("webm"));
    state.seek(0);
    recorder.start();
    play();
    everyFrame(() => {
      if (!state.playing) setTimeout(() => recorder.stop(), 300);
      return state.playing;
    });
    say("recording …");
  }

  function setChild({ target: { value } }) {
    state.change({ child: value === "" ? -1 : clamp(Math.round(value), 0, run.children - 1) });
  }

  const clicks = {
    play, all: () => state.change({ child: -1 }), previous: () => nextChild(-1), next: () => nextChild(1),
    fit: () => map.fit(), "zoom-in": () => map.zoom(1.3), "zoom-out": () => map.zoom(1 / 1.3),
    "help-open": () => byId("help").showModal(), "pair-close": () => state.change({ pair: null }),
    "save-png": () => map.canvas.toBlob((blob) => save(blob, nameOf("png"))), "save-webm": film,
  };
  for (const [name, act] of Object.entries(clicks)) byId(name).onclick = act;
  byId("follow").onchange = chase;
  Object.assign(byId("time"), { max: run.frames - 1, oninput: (event) => state.seek(Number(event.target.value)) });
  Object.assign(byId("child"), { max: run.children - 1, onchange: setChild });
  for (const name of Object.keys(state.show)) {
    byId(`show-${name}`).onchange = (event) => { state.show[name] = event.target.checked; state.change({}, "view"); };
  }
  for (const button of document.querySelectorAll("[data-copy]")) {
    const [verb, ending] = [button.dataset.copy, button.dataset.ending || ""];
    button.onclick = () => copy(verb === "run" ? info.command : `scex-sumo ${verb} ${info.quoted} --child ${Math.max(state.child, 0)}${ending}`);
  }

  const moves = {
    ArrowLeft: () => state.seek(Math.round(state.step) - 1), ArrowRight: () => state.seek(Math.round(state.step) + 1),
    Home: () => state.seek(0), End: () => state.seek(run.frames),
  };
  for (const element of document.querySelectorAll("[data-key]")) moves[element.dataset.key] = () => element.click();
  document.addEventListener("keydown", (event) => {
    const { key, target, ctrlKey, metaKey, altKey } = event, act = moves[key.length === 1 ? key.toLowerCase() : key];
    const isTyping = /INPUT|SELECT|TEXTAREA/.test(target.tagName) && target.type !== "checkbox" && key !== "Escape";
    const isPressed = key === " " && target.tagName === "BUTTON";
    if (!act || isTyping || isPressed || ctrlKey || metaKey || altKey || byId("help").open) return;
    event.preventDefault();
    act();
  });

  return { chase, draw() {
    byId("time").value = state.step;
    byId("clock").textContent = seconds(state.step);
    byId("play").textContent = state.playing ? "❚❚" : "▶";
    if (document.activeElement !== byId("child")) byId("child").value = state.child < 0 ? "" : state.child;
    byId("all").classList.toggle("on", state.child < 0);
  } };
}
