// Elements and canvases: how a page makes, colours and draws them.

const byId = (id) => document.getElementById(id);

// An element: tag with class names after dots, its text or its properties, children.
function make(tag, properties, ...children) {
  const [name, ...classes] = tag.split(".");
  const element = document.createElement(name);
  if (typeof properties === "string") element.textContent = properties;
  else Object.assign(element, properties);
  element.classList.add(...classes);
  element.append(...children.filter((child) => child));
  return element;
}

// Colours of the present theme, by the names of page.css; read once per theme.
const theme = new Proxy({ known: {} }, {
  get(target, name) {
    if (name === "forget") return () => { target.known = {}; };
    return target.known[name] ??= getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  },
});

// A canvas as sharp as the screen: its context in CSS pixels, cleared, with its size.
function sharp(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  const size = { width: Math.round(width * ratio), height: Math.round(height * ratio) };
  if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
  const context = canvas.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return { context, width, height, ratio };
}

function pathOf(points, closed = false) {
  const path = new Path2D();
  for (const [x, y] of points) path.lineTo(x, y);
  if (closed) path.closePath();
  return path;
}

function circle([x, y], radius) {
  const path = new Path2D();
  path.arc(x, y, radius, 0, 7);
  return path;
}

// Fills and strokes a path, or a line through points.
function paint(context, shape, { fill, stroke, width = 1.5, dash = [], alpha = 1 }) {
  const path = shape instanceof Path2D ? shape : pathOf(shape);
  Object.assign(context, { globalAlpha: alpha, fillStyle: fill, strokeStyle: stroke, lineWidth: width });
  context.setLineDash(dash);
  if (fill) context.fill(path);
  if (stroke) context.stroke(path);
  context.globalAlpha = 1;
}

function write(context, words, x, y, { fill = theme.soft, align = "center", font = "11px system-ui", halo } = {}) {
  Object.assign(context, { fillStyle: fill, textAlign: align, font, strokeStyle: halo, lineWidth: 3.5, lineJoin: "round" });
  if (halo) context.strokeText(words, x, y);
  context.fillText(words, x, y);
}

function say(words) {
  byId("said").textContent = words;
  setTimeout(() => { byId("said").textContent = ""; }, 3000);
}

async function copy(words) {
  try {
    await navigator.clipboard.writeText(words);
  } catch { // a page from disk may not write there
    const box = make("textarea", { value: words });
    document.body.append(box);
    box.select();
    document.execCommand("copy");
    box.remove();
  }
  say(`copied: ${words}`);
}

function save(blob, name) {
  const link = make("a", { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  say(`saved ${name}`);
}

// What is drawn again when colours change: the theme, and light ones for paper.
function onTheme(redraw) {
  const again = () => { theme.forget(); redraw(); };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  addEventListener("beforeprint", () => { document.documentElement.dataset.print = ""; again(); });
  addEventListener("afterprint", () => { delete document.documentElement.dataset.print; again(); });
}
