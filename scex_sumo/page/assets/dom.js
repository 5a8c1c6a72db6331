// Elements and canvases: how a page makes, colours and draws them.

const byId = (id) => document.getElementById(id);
const all = (selector, root = document) => [...root.querySelectorAll(selector)];

// An element: tag with class names after dots, its text or its properties, children.
function make(tag, properties, ...children) {
  const [name, ...classes] = tag.split(".");
  const element = document.createElement(name);
  if (typeof properties === "string") element.textContent = properties;
  else Object.assign(element, properties);
  element.classList.add(...classes);
  element.append(...children);
  return element;
}

// Colour of the present theme by its name in page.css, or as it is.
const styles = getComputedStyle(document.documentElement);
const inks = new Map(); // asking the style at each stroke would take most of a frame
function inked(color) {
  if (color && !inks.has(color)) inks.set(color, styles.getPropertyValue(`--${color}`) || color);
  return inks.get(color);
}

// A pen for a cleared canvas as sharp as the screen, in CSS pixels.
function sharp(canvas, { clientWidth: width, clientHeight: height } = canvas) {
  const ratio = window.devicePixelRatio, context = canvas.getContext("2d"), [across, down] = [width, height].map((size) => Math.round(size * ratio));
  context.setTransform(1, 0, 0, 1, 0, 0);
  if (canvas.width === across && canvas.height === down) context.clearRect(0, 0, across, down); // much cheaper than new memory
  else Object.assign(canvas, { width: across, height: down });
  context.scale(ratio, ratio);

  // Fills and strokes a path, a line through points, or without either the path of the context.
  function paint(shape, { fill, stroke, width: lineWidth = 1.5, dash = [], alpha = 1 }) {
    const path = !shape ? [] : [shape instanceof Path2D ? shape : pathOf(shape)];
    context.globalAlpha = alpha;
    if (fill) {
      context.fillStyle = inked(fill);
      context.fill(...path);
    }
    if (stroke) {
      Object.assign(context, { strokeStyle: inked(stroke), lineWidth });
      context.setLineDash(dash);
      context.stroke(...path);
    }
    context.globalAlpha = 1;
  }

  function write(words, x, y, { fill = "soft", align = "center", font = "11px system-ui", halo } = {}) {
    Object.assign(context, { fillStyle: inked(fill), textAlign: align, font, strokeStyle: inked(halo), lineWidth: 3.5, lineJoin: "round" });
    if (halo) context.strokeText(words, x, y);
    context.fillText(words, x, y);
  }

  return { context, paint, write, width, height, ratio };
}

// A text with a halo, drawn once: strokes of letters take long. Returns how it is put with its middle at a place.
const stamps = new Map();
function stamp(words, { fill, font = "600 12px system-ui" }) {
  const key = `${words} ${font} ${inked(fill)} ${inked("halo")} ${window.devicePixelRatio}`;
  if (!stamps.has(key)) {
    const canvas = make("canvas"), size = { clientWidth: 9 * words.length + 12, clientHeight: 20 };
    sharp(canvas, size).write(words, size.clientWidth / 2, 14, { fill, font, halo: "halo" });
    stamps.set(key, ({ context }, x, y) => context.drawImage(canvas, x - size.clientWidth / 2, y - 14, size.clientWidth, size.clientHeight));
  }
  return stamps.get(key);
}

function pathOf(points, isClosed = false) { // broken where a value is missing
  const path = new Path2D();
  let isDown = false;
  for (const [x, y] of points) {
    const isHere = Number.isFinite(y);
    if (isHere) path[isDown ? "lineTo" : "moveTo"](x, y);
    isDown = isHere;
  }
  if (isClosed) path.closePath();
  return path;
}

function circle([x, y], radius) {
  const path = new Path2D();
  path.arc(x, y, radius, 0, 7);
  return path;
}

// Sets a text unless it is there already: a new one costs a layout.
function tell(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

// Abbreviations of a page say what they mean.
const MEANINGS = {
  MAIS: "Maximum Abbreviated Injury Scale; 3+ is severe", TTC: "time to collision", WTTC: "worst-case time to collision", PTTC: "potential time to collision: the leader brakes",
  THW: "time headway", DRAC: "deceleration rate to avoid a crash", PET: "post-encroachment time", R157: "UN Regulation 157, automated lane keeping",
};
function explain(root) {
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT), texts = [];
  while (walker.nextNode()) if (!walker.currentNode.parentElement.matches("script, style, option, abbr, title")) texts.push(walker.currentNode);
  for (const text of texts) {
    const parts = text.data.split(/\b(MAIS|W?TTC|PTTC|THW|DRAC|PET|R157)\b/);
    if (parts.length > 1) text.replaceWith(...parts.map((part, i) => i % 2 ? make("abbr", { textContent: part, title: MEANINGS[part] }) : part));
  }
}

// Tells those who do not see the page what has changed, once it has come to rest.
const REST_MS = 600;
let resting = 0;
function announce(words) {
  clearTimeout(resting);
  resting = setTimeout(() => tell(byId("changes"), words), REST_MS);
}

// Values of a drawing as a table behind it, for those who do not see it.
function tabulate(canvas, title, heads, rows) {
  const cells = (tag, words) => words.map((word) => make(tag, String(word))), lines = rows.map(([name, ...values]) => make("tr", {}, make("th", { textContent: name, scope: "row" }), ...cells("td", values)));
  const table = make("table", {}, make("caption", title), make("thead", {}, make("tr", {}, ...cells("th", heads))), make("tbody", {}, ...lines)), behind = canvas.nextElementSibling;
  if (behind && behind.matches(".sr")) behind.replaceChildren(table);
  else canvas.after(make("div.sr", {}, table));
}

const say = (words) => { byId("said").textContent = words; };

function save(blob, name) {
  make("a", { href: URL.createObjectURL(blob), download: name }).click();
  say(`saved ${name}`);
}

// Calls with the seconds since the last frame until that returns false. The stamp of a frame may lie before the
// last one: then no time has passed.
function animate(onFrame) {
  let before = Infinity;
  const on = (now) => {
    const passed = clamp(now - before, 0, 100) / 1000;
    before = now;
    if (onFrame(passed)) requestAnimationFrame(on);
  };
  requestAnimationFrame(on);
}
const wantsRest = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

// What is drawn again when colours change: by the theme, or on paper.
function onTheme(redraw) {
  for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", () => {
    inks.clear();
    redraw();
  });
}
