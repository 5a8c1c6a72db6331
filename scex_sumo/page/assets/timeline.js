// Time lines: a drag selects a span of a recording, a click on a mark its moment, a click beside it nothing.

const MOMENT_S = 0.5, DRAGGED_PX = 4;

// Tells the span {recording, first, last}, or null.
function makeTimelines(onSpan) {
  const hosts = all(".timeline[data-recording]");
  const show = (host, span) => {
    for (const one of hosts) one.style.setProperty("--shown", one === host && span ? 1 : 0);
    if (span) for (const name of ["first", "last"]) host.style.setProperty(`--${name}`, (span[name] - host.dataset.first) / (host.dataset.last - host.dataset.first));
  };
  for (const host of hosts) {
    const svg = host.querySelector("svg"), { recording, first, last } = host.dataset;
    const timeAt = ({ clientX }) => {
      const { left, width } = svg.getBoundingClientRect();
      return Number(first) + clamp((clientX - left) / width, 0, 1) * (last - first);
    };
    let from = null;
    svg.onpointerdown = (event) => {
      from = event;
      event.preventDefault();
    };
    const isDrag = (event) => Boolean(from) && Math.abs(event.clientX - from.clientX) > DRAGGED_PX;
    const spanTo = (event) => {
      const ends = [timeAt(from), timeAt(event)].sort((a, b) => a - b);
      return { recording, first: ends[0], last: ends[1] };
    };
    svg.onpointermove = (event) => { if (from && isDrag(event)) show(host, spanTo(event)); };
    svg.onpointerup = (event) => {
      const t = timeAt(event), span = isDrag(event) ? spanTo(event) : event.target.matches(".dot") ? { recording, first: t - MOMENT_S, last: t + MOMENT_S } : null;
      from = null;
      show(host, span);
      onSpan(span);
    };
    svg.onpointerleave = () => { from = null; };
  }
}
