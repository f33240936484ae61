// Distances between two points of the picture, and angles at the second of three.

const MEASURES = { distance: 2, angle: 3 };

/** What the points of a measure tell, in words. */
function measureText(points, unitOfLength) {
  const from = subtract(points[0], points[1]);
  if (points.length === 2) return `${shortNumber(length(from))}${unitOfLength ? ` ${unitOfLength}` : ""}`;
  const to = subtract(points[2], points[1]);
  const cosine = dot(from, to) / (length(from) * length(to) || 1);
  return `${shortNumber((Math.acos(Math.min(Math.max(cosine, -1), 1)) * 180) / Math.PI)}°`;
}

/** The panel of measures. `set` sends changes; `changed()` is called where the picture must tell more or less. */
function measurePanel(set, changed) {
  let state = null;
  let data = null;
  let kind = null;
  let points = [];
  const say = h("p", { className: "hint", role: "status" });
  const buttons = Object.entries({ distance: ["Distance", "D"], angle: ["Angle", "A"] }).map(([name, [text, key]]) => {
    const one = button(text, () => take(kind === name ? null : name), `Measure: ${text.toLowerCase()} [${key}]`);
    one.dataset.kind = name;
    one.setAttribute("aria-pressed", "false");
    return one;
  });
  const list = h("div", {});
  const element = section("Measure", false, h("div", { className: "buttons" }, ...buttons), say, list);

  function describe() {
    for (const one of buttons) one.setAttribute("aria-pressed", String(one.dataset.kind === kind));
    say.textContent = kind
      ? `Point ${points.length + 1} of ${MEASURES[kind]}: click in the picture, or press Enter for what is in its middle. Escape ends it.`
      : "Points lie on what the picture shows. Arrow keys turn what is meant into the middle.";
  }
  function tell() {
    describe();
    changed();
  }

  /** Begins a measure of a kind; null: ends it. */
  function take(name) {
    kind = name;
    points = [];
    if (kind) element.open = true;
    tell();
  }

  function add(position) {
    if (!kind) return;
    points.push(position);
    if (points.length === MEASURES[kind]) {
      const measures = [...state.measures, points];
      points = [];
      kind = null;
      set({ measures });
      show(state, data);
    }
    tell();
  }

  function show(given, known) {
    state = given;
    data = known;
    list.replaceChildren(...state.measures.map((one, n) =>
      h("div", { className: "row" },
        h("span", { className: "name" }, `${one.length === 2 ? "Distance" : "Angle"} ${n + 1}`),
        h("span", { className: "value" }, measureText(one, data.length_unit)),
        button("Remove", () => {
          set({ measures: state.measures.filter((_, k) => k !== n) });
          show(state, data);
          changed();
        }, `Remove measure ${n + 1}`))));
  }
  describe();
  return { element, show, take, add, get kind() { return kind; }, get points() { return points; } };
}
