// Stage: the two vehicles of a card, playing while one sees it.

function makeStage(card, { outlines, contact }) {
  const shapes = all("rect", card), numbers = all("text.number", card), [acts, responds] = shapes.slice(-2), last = contact + HOLD;

  function show(step) {
    shapes.forEach((shape, i) => {
      const at = outlines[i], pose = at[Math.min(Math.floor(step), i < shapes.length - 2 ? last : contact)] || null;
      shape.style.visibility = pose ? "visible" : "hidden";
      const number = numbers[i - shapes.length + 2];
      if (pose) shape.setAttribute("transform", `translate(${pose[0]} ${pose[1]}) rotate(${pose[2]})`);
      if (pose && number) number.setAttribute("transform", `translate(${pose[0]} ${pose[1]}) scale(1 -1)`);
    });
    for (const shape of [acts, responds]) shape.classList.toggle("hit", step >= contact);
  }

  makeLoop(card, card.querySelector("svg"), { first: () => 0, rest: () => contact, last: () => last, show })();
}
