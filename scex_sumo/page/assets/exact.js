// Exact probabilities: P of every pair and of any collision, with the weights of the sliders.

// Probability that some of the cubes holds; a cube is a list of [vehicle, model].
function unionOf(cubes, sharesOf, known = new Map()) {
  if (!cubes.length) return 0;
  if (cubes.some((cube) => !cube.length)) return 1;
  const key = JSON.stringify(cubes);
  if (!known.has(key)) known.set(key, splitUnion(cubes, sharesOf, known));
  return known.get(key);
}

function splitUnion(cubes, sharesOf, known) {
  const parts = connected(cubes);
  if (parts.length > 1) return 1 - parts.reduce((none, part) => none * (1 - unionOf(part, sharesOf, known)), 1);
  const count = new Map();
  for (const [vehicle] of cubes.flat()) count.set(vehicle, (count.get(vehicle) ?? 0) + 1);
  const chosen = [...count].sort((a, b) => b[1] - a[1] || a[0] - b[0])[0][0];
  return sum(sharesOf(chosen).map((share, level) => share && share * unionOf(given(cubes, chosen, level), sharesOf, known)));
}

// What is left of cubes if a vehicle has a model.
function given(cubes, vehicle, level) {
  const left = cubes.filter((cube) => cube.every(([v, m]) => v !== vehicle || m === level));
  return left.map((cube) => cube.filter(([v]) => v !== vehicle));
}

// Groups of cubes without a common vehicle.
function connected(cubes) {
  let groups = [];
  for (const cube of cubes) {
    const mine = { vehicles: new Set(cube.map(([v]) => v)), cubes: [cube] }, apart = [];
    for (const group of groups) {
      if (![...group.vehicles].some((v) => mine.vehicles.has(v))) apart.push(group);
      else {
        group.vehicles.forEach((v) => mine.vehicles.add(v));
        mine.cubes.push(...group.cubes);
      }
    }
    groups = [...apart, mine];
  }
  return groups.map((group) => group.cubes);
}

// A share in percent, rounded to what the remainder leaves, with one significant digit or more.
function known(share, remainder) {
  if (share <= 0 || share >= 1) return `${100 * share} %`;
  const digits = (value) => Math.floor(-Math.log10(100 * value));
  const least = Math.max(digits(remainder), 0), first = digits(Math.min(share, 1 - share)) + 1;
  return `${(100 * share).toFixed(Math.min(Math.max(least, first), least + 2))} %`;
}

function exactCard({ models, shares: own, pairs, remainder, people = [], of_people: walks = [] }) {
  const sliders = all("#weights input"), figures = all("#weights output");
  let shares = own;
  // Vehicles draw from some models, people from the others.
  const alike = (m, k) => walks.includes(models[m]) === walks.includes(models[k]);
  const sharesOf = (track) => shares.map((share, m) => (walks.includes(models[m]) === people.includes(track) ? share : 0));
  const columns = [{ title: "pair" }, { title: "P", down: true }, { title: "collides exactly if", kind: "words" }];
  const rows = () => pairs.map(({ name, cubes, words, sampled, remainder: own }) => (
    { cells: [name, known(cubes ? unionOf(cubes, sharesOf) : sampled, own), words] }));
  const table = makeTable(byId("exact-table"), { columns, rows: rows() });

  function draw() {
    sliders.forEach((slider, m) => { slider.value = shares[m]; figures[m].textContent = percent(shares[m]); });
    const isWhole = pairs.every(({ cubes }) => cubes);
    byId("any-collision").textContent = isWhole ? known(unionOf(pairs.flatMap(({ cubes }) => cubes), sharesOf), remainder) : "sampled only";
    table.show(rows());
  }

  // The other models share the rest as they did before.
  function weigh(m, value) {
    const rest = 1 - shares[m], others = models.filter((_, k) => alike(m, k)).length - 1;
    const given = (share) => (rest > 1e-9 ? share * (1 - value) / rest : (1 - value) / others);
    shares = shares.map((share, k) => (k === m ? value : alike(m, k) ? given(share) : share));
    draw();
    announce(`any collision ${byId("any-collision").textContent}`);
  }

  sliders.forEach((slider, m) => { slider.oninput = () => weigh(m, Number(slider.value)); });
  byId("own-weights").onclick = () => { shares = own; draw(); };
  draw();
}
