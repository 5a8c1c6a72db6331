// Address of a page: what follows "#" keeps its state, so that a link or a reload shows the same.

const ADDRESS_MS = 250; // browsers refuse frequent changes

// `parts` are names with a getter, and a setter that takes the text or null.
function keepInAddress(state, parts) {
  let timer = 0;

  function write() {
    timer = 0;
    const known = Object.entries(parts).flatMap(([name, { get }]) => Object.entries(get()).map(([key, value]) => [name + key, value]));
    const words = new URLSearchParams(known.filter(([, value]) => !isMissing(value) && value !== "")).toString();
    const address = `#${words.replaceAll("%2C", ",")}`;
    if (address !== location.hash) try {
      history.replaceState(null, "", address);
    } catch { /* a frame of a notebook has no address of its own */ }
  }

  function later() {
    if (!timer) timer = setTimeout(write, ADDRESS_MS);
  }

  function read(address = location.href) { // true if there was a state
    const words = new URLSearchParams(new URL(address).hash.slice(1));
    for (const [name, { set }] of Object.entries(parts)) {
      const mine = [...words].filter(([key]) => name.endsWith(".") ? key.startsWith(name) : key === name);
      set(Object.fromEntries(mine.map(([key, value]) => [key.slice(name.length), value])));
    }
    return words.size > 0;
  }
  return { later, read };
}
