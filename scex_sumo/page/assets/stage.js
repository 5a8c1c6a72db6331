// Stage: the two vehicles of a card, playing while one sees it.

const BEFORE = 10, HOLD = 12; // steps before the moment, and after the contact

function makeStage(card, { outlines, contact }) {
  const shapes = all("rect", card), [acts, responds] = shapes.slice(-2), last = contact + HOLD;
  let step = BEFORE, since = 0, isSeen = false, isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;

  function show() {
    shapes.forEach((shape, i) => {
      const at = outlines[i], pose = at[Math.min(Math.floor(step), i < shapes.length - 2 ? last : contact)] || null;
      shape.style.visibility = pose ? "visible" : "hidden";
      if (pose) shape.setAttribute("transform", `translate(${pose[0]} ${pose[1]}) rotate(${pose[2]})`);
    });
    for (const shape of [acts, responds]) shape.classList.toggle("hit", step >= contact);
  }

  function play(now) {
    if (!isSeen || isStill) return;
    step += Math.min(now - since, 100) / 100;
    if (step > last) step = 0;
    since = now;
    show();
    requestAnimationFrame(play);
  }

  const start = () => {
    since = performance.now();
    requestAnimationFrame(play);
  };
  new IntersectionObserver(([{ isIntersecting }]) => {
    const isNew = isIntersecting && !isSeen;
    isSeen = isIntersecting;
    if (isNew) start();
  }).observe(card);
  card.querySelector("svg").onclick = () => {
    isStill = !isStill;
    if (!isStill) start();
  };
  step = isStill ? contact : BEFORE;
  show();
}
