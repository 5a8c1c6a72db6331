// Loop: a motion that plays while one sees it, again and again; a click holds it.

const HOLD = 12; // steps after the contact

// Steps: `first` and `last` are its ends, `rest` is shown to those who want no motion.
function makeLoop(host, button, { first, rest, last, show }) {
  let step = 0, isOn = false, isSeen = false, isStill = wantsRest();

  function start() {
    if (!isOn) animate((passed) => {
      isOn = isSeen && !isStill;
      if (!isOn) return false;
      step += 10 * passed;
      if (step > last()) step = first();
      show(step);
      return true;
    });
    isOn = true;
  }

  new IntersectionObserver(([{ isIntersecting }]) => {
    isSeen = isIntersecting;
    if (isSeen) start();
  }).observe(host);
  button.onclick = () => {
    isStill = !isStill;
    start();
  };
  return () => { // from the start
    step = isStill ? rest() : first();
    show(step);
  };
}
