// Loop: a motion that plays while one sees it, again and again; a click holds it.

const HOLD = 12; // steps after the contact

// Steps: `first` and `last` are its ends, `rest` is shown to those who want no motion.
function makeLoop(host, button, { first, rest, last, show }) {
  let step = 0, since = 0, isSeen = false, isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;

  function play(now) {
    if (!isSeen || isStill) return;
    step += Math.min(now - since, 100) / 100;
    if (step > last()) step = first();
    since = now;
    show(step);
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
  }).observe(host);
  button.onclick = () => {
    isStill = !isStill;
    if (!isStill) start();
  };
  return () => { // from the start
    step = isStill ? rest() : first();
    show(step);
  };
}
