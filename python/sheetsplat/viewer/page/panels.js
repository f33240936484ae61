// The panels beside the picture. Each is {element, show(state, data)}; `set` sends changes to the session.

// How slices become pixels (the modes' `fold`): what shows colours, in place of numbers.
const COLORED = ["opacities", "surfaces"];

function lookPanel(set, offered) {
  let group = 0;
  let state = null;
  let data = null;
  const change = (part) => set({ look: { group, ...part } });
  const channels = channelRows(set);
  const coloring = colorByRows(set, offered);
  const labels = labelRows(change);
  const groups = choice([], (value) => {
    group = Number(value);
    show(state, data);
  }, "Data whose transfer function is shown");
  const editor = transferEditor(change);
  const maps = choice([], (cmap) => cmap && change({ cmap }), "Colours");
  const words = choice([], (word) => {
    if (word) change({ word });
    words.value = "";
  }, "Shape of the opacity curve");
  const presets = choice([], (preset) => {
    if (preset) change({ preset });
    presets.value = "";
  }, "Transfer functions for CT in Hounsfield units");
  const ends = ["Lowest value", "Highest value"].map((title) =>
    h("input", { type: "number", step: "any", className: "number", title, "aria-label": title, onchange: stretch }),
  );

  function stretch() {
    const range = ends.map((one) => Number(one.value));
    if (range.every(Number.isFinite) && range[0] < range[1]) change({ range });
  }

  const unitNote = h("p", { className: "hint" }, "Presets are for Hounsfield units, which these data do not state.");
  const own = h("p", { className: "hint" },
    "Drag the points. Double-click adds one, right-click or Delete removes it. Double-click a colour to change it.");
  const curves = h("div", {}, editor,
    row("Colours", maps), row("Opacity curve", words), row("Preset", presets), unitNote, row("Range", ...ends),
    h("div", { className: "buttons" }, button("Automatic", () => change({ automatic: true }), "Colours and opacities by the histogram")),
    ...presetRows(() => state.looks[group], change), own);
  const function_ = h("div", {}, channels, row("Edit", groups), curves, labels);
  const surfaces = h("div", {});
  const limits = ["Lowest number", "Highest number"].map((title) =>
    h("input", { type: "number", step: "any", className: "number", title, "aria-label": title, onchange: recolor }),
  );
  const automatic = checkbox("Automatic range", recolor);
  const log = checkbox("Logarithmic colours", recolor);
  const scalarMaps = choice([], recolor, "Colours");
  const scalar = h("div", {}, row("Colours", scalarMaps), automatic, row("Range", ...limits), log);

  function recolor() {
    const clim = limits.map((one) => Number(one.value));
    const good = !automatic.firstChild.checked && limits.every((one) => one.value !== "") && clim[0] < clim[1];
    limits.forEach((one) => {
      one.disabled = automatic.firstChild.checked;
    });
    set({ scalar_colors: { cmap: scalarMaps.value || "gray", clim: good ? clim : null, log: log.firstChild.checked } });
  }

  function showSurfaces() {
    if (surfaces.matches(":focus-within, :active")) return;
    const histogram = data.groups[0];
    const given = state.surfaces.map(({ value, opacity, color, automatic: own }) => ({
      value, opacity, color: own ? null : color, shown: color,
    }));
    const send = () => set({ surfaces: given.map(({ value, opacity, color }) => ({ value, opacity, color })) });
    const rows = given.map((one, n) => {
      const value = slider("Value", { low: histogram.low, high: histogram.high, change: (at) => { one.value = at; send(); } });
      value.show(one.value);
      const opacity = slider("Opacity", { low: 0, high: 1, change: (at) => { one.opacity = Math.min(Math.max(at, 0), 1); send(); } });
      opacity.show(one.opacity);
      const color = colorField((picked) => { one.color = picked; send(); }, "Colour of the surface");
      color.show(one.shown);
      const buttons = [color, button("Automatic colour", () => { one.color = null; send(); })];
      if (given.length > 1) buttons.push(button("Remove", () => { given.splice(n, 1); send(); }));
      return h("div", { className: "group" }, value, opacity, h("div", { className: "buttons" }, ...buttons));
    });
    const more = button("Add a surface", () => {
      const last = given[given.length - 1];
      const value = Math.min(last.value + 0.15 * (histogram.high - histogram.low), histogram.high);
      // What lies inside shows through the others.
      given.forEach((one) => { one.opacity = Math.min(one.opacity, 0.35); });
      given.push({ value, opacity: 1, color: null });
      send();
    });
    surfaces.replaceChildren(...rows, h("div", { className: "buttons" }, more));
  }

  function show(given, known) {
    state = given;
    data = known;
    if (!state) return;
    coloring.show(state, data);
    // Groups without a look are shown by surfaces.
    const looking = state.looks.flatMap((look, n) => (look ? [n] : []));
    function_.hidden = !looking.length;
    surfaces.hidden = state.fold !== "surfaces" || (looking.length > 0 && looking.length === state.looks.length);
    scalar.hidden = COLORED.includes(state.fold) || !function_.hidden;
    if (!surfaces.hidden) showSurfaces();
    if (!function_.hidden) {
      if (!looking.includes(group)) group = looking[0];
      groups.parentElement.hidden = looking.length < 2;
      groups.offer(looking.map((n) => [String(n), `${n + 1}: ${data.groups[n].label}`]));
      groups.show(String(group));
      channels.show(state.looks, data.groups);
      const look = state.looks[group];
      labels.hidden = !look.labels;
      curves.hidden = !labels.hidden;
      if (look.labels) {
        labels.show(look.labels);
        return;
      }
      const names = Object.keys(offered().colormaps);
      maps.offer([...(look.cmap && names.includes(look.cmap) ? [] : [[look.cmap, look.cmap || "own colours"]]), ...names]);
      maps.show(look.cmap);
      words.offer([["", "choose …"], ...offered().words]);
      unitNote.hidden = data.groups[group].unit === "HU";
      presets.offer([["", "choose …"], ...offered().presets]);
      look.range.forEach((value, n) => {
        if (document.activeElement !== ends[n]) ends[n].value = Number(value.toPrecision(6));
      });
      editor.show(look, data.groups[group]);
    } else if (!scalar.hidden) {
      const { cmap, clim, log: isLog } = state.scalar_colors;
      const names = Object.keys(offered().colormaps);
      scalarMaps.offer([...(names.includes(cmap) ? [] : [[cmap, cmap || "own colours"]]), ...names]);
      scalarMaps.show(cmap);
      automatic.show(!clim);
      log.show(isLog);
      limits.forEach((one, n) => {
        one.disabled = !clim;
        if (clim && document.activeElement !== one) one.value = clim[n];
      });
    }
  }
  return { element: section("Colours and opacity", true, function_, surfaces, scalar, coloring), show, editor };
}

/** A pad that shows a ball and where its light comes from. */
function lightPad(change) {
  const canvas = h("canvas", { className: "pad", title: "Drag to turn the light", tabIndex: 0, role: "application" });
  canvas.setAttribute("aria-label", "Direction of the light; arrow keys turn it");
  let direction = [0, 0, 1];
  function draw() {
    const { context, width } = fitted(canvas);
    if (!width) return;
    const radius = width / 2 - 4;
    const [x, y, z] = unit(direction);
    const shade = context.createRadialGradient(
      width / 2 + x * radius * 0.9, width / 2 - y * radius * 0.9, radius * 0.05,
      width / 2 + x * radius * 0.4, width / 2 - y * radius * 0.4, radius * 1.5);
    shade.addColorStop(0, z >= 0 ? "#fff" : "#aaa");
    shade.addColorStop(0.5, z >= 0 ? "#889" : "#445");
    shade.addColorStop(1, "#112");
    context.fillStyle = shade;
    context.beginPath();
    context.arc(width / 2, width / 2, radius, 0, 2 * Math.PI);
    context.fill();
    context.beginPath();
    context.arc(width / 2 + x * radius, width / 2 - y * radius, 4, 0, 2 * Math.PI);
    context.fillStyle = "#ffd24a";
    context.fill();
  }
  function point(event) {
    const width = canvas.clientWidth;
    let x = (event.offsetX - width / 2) / (width / 2 - 4);
    let y = (width / 2 - event.offsetY) / (width / 2 - 4);
    const far = Math.hypot(x, y);
    if (far > 1) [x, y] = [x / far, y / far];
    direction = [x, y, Math.sqrt(Math.max(0, 1 - x * x - y * y))].map((part) => Number(part.toFixed(4)));
    draw();
    change(direction);
  }
  dragging(canvas, { start: (event) => { point(event); return true; }, move: point });
  canvas.addEventListener("keydown", (event) => {
    const [across, upwards] = ARROWS[event.key] || [0, 0];
    if (!across && !upwards) return;
    event.preventDefault();
    event.stopPropagation();
    const turned = rotated(rotated(unit(direction), [0, 1, 0], 0.1 * across), [1, 0, 0], -0.1 * upwards);
    direction = turned.map((part) => Number(part.toFixed(4)));
    draw();
    change(direction);
  });
  new ResizeObserver(draw).observe(canvas);
  canvas.show = (given) => {
    direction = given;
    draw();
  };
  return canvas;
}

function lightPanel(set) {
  let state = null;
  let data = null;
  const lit = checkbox("Light", (on) => set({ lights: on ? [{ direction: [-0.3, 0.4, 1], color: [1, 1, 1], space: "eye" }] : [] }));
  const first = (part) => {
    const lights = state.lights.map(({ direction, color, space }) => ({ direction, color, space }));
    if (!lights.length) return;
    lights[0] = { ...lights[0], ...part };
    set({ lights });
  };
  const pad = lightPad((direction) => first({ direction }));
  const fixed = checkbox("The light stays where it is when the view turns", (on) => first({ space: on ? "world" : "eye" }));
  const color = colorField((value) => first({ color: partsOf(value) }), "Colour of the light");
  const names = { ambient: [0, 1.5], diffuse: [0, 1.5], specular: [0, 1.5], shininess: [1, 128] };
  const material = Object.fromEntries(Object.entries(names).map(([name, [low, high]]) => [
    name,
    slider(name[0].toUpperCase() + name.slice(1), { low, high, change: (value) => {
      state.material[name] = value;
      set({ material: state.material });
    } }),
  ]));
  const shadows = checkbox("Shadows", (on) => set({ shadows: on }));
  const occlusion = checkbox("Ambient occlusion", (on) => set({ ambient_occlusion: on ? { radius: 0.04 * data.diagonal, strength: 1 } : null }));
  const radius = slider("Radius", { low: 0, high: 1, power: 2, change: (value) => set({ ambient_occlusion: { ...state.ambient_occlusion, radius: Math.max(value, 1e-6 * data.diagonal) } }) });
  const dark = slider("Strength", { low: 0, high: 1, change: (value) => set({ ambient_occlusion: { ...state.ambient_occlusion, strength: Math.min(Math.max(value, 0), 1) } }) });
  const cue = checkbox("Fade with depth", (on) => set({ depth_cue: on ? { strength: 0.8, color: "#000000" } : null }));
  const fade = slider("Strength", { low: 0, high: 1, change: (value) => set({ depth_cue: { ...state.depth_cue, strength: Math.min(Math.max(value, 0), 1) } }) });
  const fog = colorField((value) => set({ depth_cue: { ...state.depth_cue, color: value } }), "Colour that depth fades to");
  const steep = checkbox("Hide regions of little change", (on) => set({ gradient_opacity: on ? slope() / 4 : null }),
    "Opacity is multiplied by the gradient over a reference, up to 1");
  const reference = slider("Gradient", { low: 0, high: 1, power: 2, change: (value) => set({ gradient_opacity: Math.max(value, 1e-9 * slope()) }) });
  const slope = () => (40 * (data.groups[0].high - data.groups[0].low)) / data.diagonal;
  const lamp = h("div", { className: "lamp" }, pad, h("div", {}, row("Colour", color), fixed));
  const inOcclusion = h("div", { className: "group" }, radius, dark);
  const inCue = h("div", { className: "group" }, fade, row("To", fog));
  const inSteep = h("div", { className: "group" }, reference);
  const note = h("p", { className: "hint" }, "This mode has no light.");
  const all = h("div", {}, lit, lamp, ...Object.values(material), shadows, occlusion, inOcclusion, cue, inCue, steep, inSteep);

  function show(given, known) {
    state = given;
    data = known;
    const colored = COLORED.includes(state.fold);
    all.hidden = !colored;
    note.hidden = colored;
    lit.show(state.lights.length);
    lamp.hidden = !state.lights.length;
    if (state.lights.length) {
      pad.show(state.lights[0].direction);
      fixed.show(state.lights[0].space === "world");
      color.show(hexOf(state.lights[0].color));
    }
    for (const [name, one] of Object.entries(material)) one.show(state.material[name]);
    shadows.show(state.shadows);
    shadows.hidden = !state.lights.length;
    occlusion.show(state.ambient_occlusion);
    inOcclusion.hidden = !state.ambient_occlusion;
    if (state.ambient_occlusion) {
      radius.limits(0, 0.25 * data.diagonal);
      radius.show(state.ambient_occlusion.radius);
      dark.show(state.ambient_occlusion.strength);
    }
    cue.show(state.depth_cue);
    inCue.hidden = !state.depth_cue;
    if (state.depth_cue) {
      fade.show(state.depth_cue.strength);
      fog.show(state.depth_cue.color);
    }
    steep.hidden = state.fold !== "opacities";
    steep.show(state.gradient_opacity);
    inSteep.hidden = !state.gradient_opacity || steep.hidden;
    reference.limits(0, slope());
    if (state.gradient_opacity) reference.show(state.gradient_opacity);
  }
  return { element: section("Light", false, note, all), show };
}

function clipPanel(set, cameraOf) {
  let state = null;
  let data = null;
  const send = (clip) => {
    state.clip = clip;
    set({ clip });
    showFaces();
  };
  const faces = checkbox("Light the faces of cuts", (on) => {
    Object.assign(state, { cut_faces: on, changed: [...state.changed, "cut_faces"] });
    set({ cut_faces: on });
  },
    "Where a cut, or the end of a volume, opens what is opaque, light takes the direction of the face");
  function showFaces() {
    // Unless that was decided on, a first cut does.
    const follow = state.faces_follow && !state.changed.includes("cut_faces");
    faces.hidden = !state.lights.length || state.fold !== "opacities";
    faces.show(state.cut_faces || (follow && (state.clip.box || state.clip.planes.length)));
  }
  const boxed = checkbox("Box", (on) => send({ ...state.clip, box: on ? inner() : null }));
  const inner = () => structuredClone(data.bounds);
  const sides = AXES.flatMap(([name], axis) => ["from", "to"].map((word, side) =>
    slider(`${name} ${word}`, { low: 0, high: 1, change: (value) => {
      const box = structuredClone(state.clip.box || data.bounds);
      box[side][axis] = value;
      if (box[0][axis] > box[1][axis]) box[1 - side][axis] = value;
      send({ ...state.clip, box });
    } })));
  const inBox = h("div", { className: "group" }, ...sides);
  const planes = h("div", {});
  const addPlane = (normal) => {
    const middle = middleOf(data.bounds);
    send({ ...state.clip, planes: [...state.clip.planes, [normal, dot(normal, middle)]] });
    show(state, data);
  };
  const adders = h("div", { className: "buttons" },
    ...AXES.map(([name], axis) => button(`Plane across ${name}`, () => addPlane([0, 1, 2].map((n) => (n === axis ? -1 : 0))))),
    button("Plane facing the view", () => addPlane(scaled(axesOf(cameraOf()).back, -1))));
  const none = button("Remove all", () => { send({ planes: [], box: null }); show(state, data); });

  function showPlanes() {
    if (planes.matches(":focus-within, :active")) return;
    planes.replaceChildren(...state.clip.planes.map(([normal, offset], n) => {
      const changed = (plane) => send({ ...state.clip, planes: state.clip.planes.map((one, k) => (k === n ? plane : one)) });
      // A plane across an axis tells where it cuts the axis; any other one its distance along its normal.
      const axes = [0, 1, 2].filter((axis) => normal[axis] !== 0);
      const [unit, name] = axes.length === 1 ? [normal[axes[0]], `: ${AXES[axes[0]][0]}`] : [1, ""];
      const middle = dot(normal, middleOf(data.bounds)) / unit;
      const reach = 0.5 * data.diagonal * length(normal) / Math.abs(unit);
      const [low, high] = name ? data.bounds.map((corner) => corner[axes[0]]) : [middle - reach, middle + reach];
      const place = slider(`Plane ${n + 1}${name}`, { low, high, change: (value) => changed([normal, value * unit]) });
      place.show(offset / unit);
      return h("div", { className: "group" }, place, h("div", { className: "buttons" },
        button("Other side", () => changed([scaled(normal, -1), -offset])),
        button("Remove", () => { send({ ...state.clip, planes: state.clip.planes.filter((_, k) => k !== n) }); show(state, data); })));
    }));
  }

  function show(given, known) {
    state = given;
    data = known;
    boxed.show(state.clip.box);
    inBox.hidden = !state.clip.box;
    sides.forEach((one, n) => {
      const axis = n >> 1;
      one.limits(data.bounds[0][axis], data.bounds[1][axis]);
      if (state.clip.box) one.show(state.clip.box[n & 1][axis]);
    });
    showFaces();
    showPlanes();
    none.hidden = !state.clip.box && !state.clip.planes.length;
  }
  const hint = h("p", { className: "hint" }, "Drag the handles in the picture: box sides and planes move along their direction, the white end of an arrow turns its plane.");
  const element = section("Clip", false, boxed, inBox, planes, adders, none, faces, hint);
  element.addEventListener("toggle", () => element.dispatchEvent(new CustomEvent("shown", { bubbles: true })));
  return { element, show };
}

function qualityPanel(set, send) {
  const qualities = choice([["draft", "Draft: fast"], ["good", "Good"], ["best", "Best: slow"]], (quality) => set({ quality }), "What the picture is worth");
  const limit = (label, name, title) => {
    const input = h("input", { type: "number", step: "any", min: 0, className: "number", placeholder: "none", title, "aria-label": label });
    input.addEventListener("change", () => set({ [name]: input.value === "" ? null : Number(input.value) }));
    const element = row(label, input);
    element.show = (value) => {
      if (document.activeElement !== input) input.value = value ?? "";
    };
    return element;
  };
  const error = limit("Largest error", "max_error", "Root mean square distance from the converged picture, 0 to 1");
  const seconds = limit("Longest time [s]", "max_seconds", "How long a complete picture may take");
  const measured = h("div", { className: "numbers" });
  const measure = button("Measure the error", () => send({ type: "measure", what: "error" }), "Draws further pictures of this view, about five times its time");
  const shown = checkbox("Show the error of each pixel", (on) => element.dispatchEvent(new CustomEvent("errormap", { detail: on, bubbles: true })));
  shown.hidden = true;
  const settings = h("table", { className: "settings" });
  const element = section("Quality", false, row("Quality", qualities), error, seconds,
    h("div", { className: "buttons" }, measure), measured, shown, settings);
  return {
    element,
    show(state, data) {
      qualities.show(state.quality);
      qualities.parentElement.hidden = data.fixed_quality;
      error.show(state.max_error);
      seconds.show(state.max_seconds);
    },
    showPlan(plan) {
      settings.replaceChildren(...plan.quality.map(([name, value, why]) => h("tr", {}, h("td", {}, name), h("td", {}, value), h("td", {}, why))));
    },
    showError(found) {
      shown.hidden = !found;
      if (!found) {
        shown.show(false);
        measured.replaceChildren();
        return;
      }
      const parts = Object.entries(found.budget).sort((a, b) => b[1] - a[1]).slice(0, 4);
      measured.replaceChildren(
        h("p", {}, `Error of this picture: ${shortNumber(found.rmse)} (root mean square; 0 to 1)`),
        h("table", { className: "settings" }, ...parts.map(([cause, value]) => h("tr", {}, h("td", {}, cause), h("td", {}, shortNumber(value))))));
    },
    busy(on) {
      measure.disabled = on;
      measure.textContent = on ? "Measuring …" : "Measure the error";
    },
  };
}

function planPanel(set, send) {
  let forced = {};
  let plan = null;
  const only = checkbox("Only those that are on", () => draw());
  only.show(true);
  const rows = h("table", { className: "settings" });
  const table = h("table", { className: "plan" });
  const measure = button("Measure what each costs", () => send({ type: "measure", what: "effects" }),
    "Draws small pictures of this view with and without each effect; any change stops it");
  const element = section("Plan: what is drawn, and why", false, rows, h("div", { className: "buttons" }, measure, only), table);

  function draw() {
    if (!plan) return;
    rows.replaceChildren(...plan.rows.map(([name, text]) => h("tr", {}, h("td", {}, name), h("td", {}, text))));
    const wanted = plan.effects.filter((one) => one.on || one.forced || !only.firstChild.checked);
    const head = h("tr", {}, ...["Effect", "State", "ms", "Error"].map((text) => h("th", {}, text)));
    table.replaceChildren(head, ...wanted.flatMap((one) => {
      const ways = choice([["", one.on && !one.forced ? "on" : one.on ? "auto" : one.forced ? "auto" : "off"], ["on", "force on"], ["off", "force off"]], (value) => {
        const effects = { ...forced };
        if (value) effects[one.name] = value === "on";
        else delete effects[one.name];
        set({ effects });
      }, `Force ${one.name.replaceAll("_", " ")} on or off`);
      ways.show(one.name in forced ? (forced[one.name] ? "on" : "off") : "");
      const cost = one.milliseconds;
      return [
        h("tr", { className: one.on ? "on" : "off" },
          h("td", {}, one.name.replaceAll("_", " ")), h("td", {}, ways),
          h("td", {}, cost === null || cost === undefined ? "" : one.on ? cost.toFixed(2) : `(${cost.toFixed(2)})`),
          h("td", {}, one.on && one.error > 0 ? one.error.toExponential(0).replace("-", "−") : "")),
        h("tr", { className: "why" }, h("td", { colSpan: 4 }, one.why + (one.forced ? " (forced)" : ""))),
      ];
    }));
  }
  return {
    element,
    show(state) {
      forced = state.effects;
    },
    showPlan(given) {
      plan = given;
      if (element.open) draw();
    },
    showCosts(costs) {
      for (const one of plan ? plan.effects : []) one.milliseconds = costs[one.name];
      draw();
    },
    busy(on) {
      measure.disabled = on;
      measure.textContent = on ? "Measuring …" : "Measure what each costs";
    },
    draw,
  };
}

/** What a film shows; `make(message)` orders it, `stop()` gives it up. `show(share)` tells the progress, null: none. */
function filmDialog(make, stop) {
  let count = 1;
  const whats = choice([["turn", "One turn about what is seen"]], () => ask(), "What the film shows");
  const number = (label, value, low, high) =>
    h("input", { type: "number", className: "number", value, min: low, max: high, step: 1, "aria-label": label });
  const frames = number("Frames", 90, 2, 2000);
  const fps = number("Frames a second", 30, 1, 120);
  const kinds = choice([["mp4", "MP4"], ["webm", "WebM"], ["gif", "GIF"]], () => {}, "Kind of file");
  const note = h("p", { className: "hint" });
  const start = button("Make the film", () => {
    if (!frames.checkValidity() || !fps.checkValidity()) return;
    dialog.close();
    make({ type: "film", what: whats.value, frames: Number(frames.value), fps: Number(fps.value), kind: kinds.value });
    show(0);
  });
  const dialog = h("dialog", {}, h("h2", {}, "Film"), row("Shows", whats), row("Frames", frames), row("A second", fps), row("File", kinds), note, start,
    button("Close", () => dialog.close()));
  const text = h("span", {});
  const progress = h("span", { className: "filming", hidden: true }, text, button("Stop", stop, "Give the film up"));

  function ask() {
    const turns = whats.value === "turn";
    frames.parentElement.hidden = !turns;
    const about = turns ? "The eye turns about the middle of the view. " : `${count} times, one after the other, seen from here. `;
    note.textContent = `${about}Size and look are those of the picture now; it may be changed meanwhile.`;
    if (!dialog.open) dialog.showModal();
  }
  function show(share) {
    progress.hidden = share === null;
    if (share !== null) text.textContent = `film ${Math.floor(100 * share)} % `;
  }
  return {
    dialog,
    progress,
    ask,
    show,
    offer(times) {
      if (times === count) return;
      count = times;
      whats.offer([["turn", "One turn about what is seen"], ...(times > 1 ? [["times", "The times"]] : [])]);
    },
  };
}
