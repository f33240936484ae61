// Slice planes: one across each axis, and one of any direction.

// A free plane is never quite across an axis, which would make it one of the others.
const BARELY = 1e-6;
const DEGREES = 180 / Math.PI;

/** The normal of two angles in degrees: about z from x on, and above the plane of x and y. */
function normalOf(azimuth, elevation) {
  const [a, e] = [azimuth / DEGREES, elevation / DEGREES];
  const made = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  return made.filter((part) => part === 0).length === 2 ? unit(made.map((part) => part || BARELY)) : made;
}

function planePanel(set, offered, cameraOf) {
  let state = null;
  let data = null;
  const axisOf = ({ normal }) => [0, 1, 2].find((axis) => normal.every((part, n) => part === (n === axis ? 1 : 0)));
  const across = (axis) => state.slice_planes.find((one) => axisOf(one) === axis);
  const free = () => state.slice_planes.find((one) => axisOf(one) === undefined);
  const middle = () => middleOf(data.box);
  const offsetOf = (plane) => plane.offset ?? dot(plane.normal, middle());
  function send(planes) {
    set({ slice_planes: planes });
    show(state, data);
  }
  // New planes have the colours of those that are there, else the viewer's own.
  const like = () => ({ cmap: null, clim: null, ...state.slice_planes[0] });
  const put = (before, normal, offset) => {
    const made = { ...(before || like()), normal, offset };
    send(before ? state.slice_planes.map((one) => (one === before ? made : one)) : [...state.slice_planes, made]);
  };
  const without = (plane) => send(state.slice_planes.filter((one) => one !== plane));

  const rows = AXES.map(([name], axis) => {
    const normal = [0, 1, 2].map((n) => Number(n === axis));
    const box = checkbox(`Across ${name}`, (on) => (on ? put(null, normal, middle()[axis]) : without(across(axis))));
    const place = slider(`${name} =`, { low: 0, high: 1, change: (value) => across(axis) && put(across(axis), normal, value), title: `Where the plane cuts ${name}` });
    return { box, place };
  });
  const turn = (normal) => put(free(), normal, dot(normal, middle()) + beside());
  const beside = () => (free() ? (offsetOf(free()) - dot(free().normal, middle())) / length(free().normal) : 0);
  const anglesOf = (normal) => {
    const [x, y, z] = unit(normal);
    return [Math.atan2(y, x) * DEGREES, Math.asin(Math.min(Math.max(z, -1), 1)) * DEGREES];
  };
  const angles = () => (free() ? anglesOf(free().normal) : [45, 30]);
  const freely = checkbox("Of any direction", (on) => (on ? turn(normalOf(45, 30)) : without(free())));
  // At the poles a normal has no azimuth of its own.
  let around = 45;
  const azimuth = slider("Azimuth [°]", { low: -180, high: 180, change: (value) => { around = value; turn(normalOf(value, angles()[1])); }, title: "Of the normal, about z from x on" });
  const elevation = slider("Elevation [°]", { low: -90, high: 90, change: (value) => turn(normalOf(around, Math.min(Math.max(value, -90), 90))), title: "Of the normal, above the plane of x and y" });
  const distance = slider("Distance", { low: -1, high: 1, change: (value) => put(free(), unit(free().normal), dot(unit(free().normal), middle()) + value), title: "From the middle of the data, along the normal" });
  const facing = button("Face the view", () => turn(axesOf(cameraOf()).back));
  const inFree = h("div", { className: "group" }, azimuth, elevation, distance, h("div", { className: "buttons" }, facing));
  const maps = choice([], (cmap) => send(state.slice_planes.map((one) => ({ ...one, cmap }))), "Colours of the planes");
  const mapped = row("Colours", maps);
  const none = button("Remove the planes", () => send([]));
  const note = h("p", { className: "hint" }, "This mode has no slice planes.");
  const all = h("div", {}, ...rows.flatMap(({ box, place }) => [box, place]), freely, inFree, mapped, h("div", { className: "buttons" }, none));

  function show(given, known) {
    state = given;
    data = known;
    all.hidden = !COLORED.includes(state.fold);
    note.hidden = !all.hidden;
    rows.forEach(({ box, place }, axis) => {
      const plane = across(axis);
      box.show(plane);
      place.hidden = !plane;
      place.limits(data.box[0][axis], data.box[1][axis]);
      if (plane) place.show(offsetOf(plane));
    });
    const plane = free();
    freely.show(plane);
    inFree.hidden = !plane;
    if (plane) {
      const [a, e] = angles();
      if (Math.abs(e) < 90 - BARELY) around = a;
      azimuth.show(around);
      elevation.show(e);
      distance.limits(-0.5 * data.diagonal, 0.5 * data.diagonal);
      distance.show(beside());
    }
    mapped.hidden = none.hidden = !state.slice_planes.length;
    if (!mapped.hidden) {
      const own = state.slice_planes[0].cmap;
      const names = Object.keys(offered().colormaps);
      maps.offer(names.includes(own) ? names : [[String(own), typeof own === "string" ? own : "own colours"], ...names]);
      maps.show(String(own));
    }
  }
  return { element: section("Slice planes", false, note, all), show };
}
