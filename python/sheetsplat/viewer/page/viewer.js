// The viewer: the picture, what is over and beside it, and what hands do with it.

// Pictures follow the window when it has not changed for so many milliseconds.
const SETTLED = 120;
const FLIGHT = 280;
const MOST_PIXELS = 2600 * 1600;

// A picture that lets one wait longer says that it is being drawn.
const IMPATIENT = 400;
// How long the camera that hands moved counts more than those of pictures that were drawn before.
const OWN = 2000;

/** Whether two cameras are the same, as far as they have the same numbers. */
function sameCamera(a, b) {
  const numbers = (one) => [...one.eye, ...one.target, one.height ?? one.fov_y];
  return a.kind === b.kind && numbers(a).every((number, n) => number === numbers(b)[n]) && dot(unit(axesOf(a).up), unit(axesOf(b).up)) > 1 - 1e-9;
}

/**
 * Shows a session within an element. `connect(handlers)` returns {send(message), close()}; it calls handlers.open(),
 * handlers.message(message, bytes) and handlers.lost(text). `keys`: whose keys are listened to. Returns what tests and
 * widgets need.
 */
function mount(root, connect, keys = root) {
  let offered = { modes: [], colormaps: {}, words: [], presets: [] };
  let state = null;
  let data = null;
  let seen = null; // The data that the picture shows.
  let camera = null; // The one that hands move; the picture's own may be older.
  let own = 0; // When hands moved it, until a picture shows it.
  let drawn = { number: 0, camera: null, size: [1, 1], bars: [] };
  let pending = {};
  let flight = 0;
  let about = { plan: null };
  let lastError = "";
  const counts = { frames: 0, dropped: 0, stale: 0, errors: 0 };

  // What hands change goes out once a frame of the screen, the newest of each kind.
  function sendPending() {
    if (!Object.keys(pending).length) return;
    line.send({ type: "set", changes: pending });
    pending = {};
  }
  const flush = perFrame(sendPending);
  function set(changes) {
    if (!state) return;
    for (const [name, value] of Object.entries(changes)) {
      if (name === "look" && pending.look && pending.look.group !== value.group) sendPending();
      pending[name] = name === "look" ? { ...pending.look, ...value } : value;
      if (name in state && name !== "look") state[name] = value;
    }
    forgetError();
    hint.classList.remove("shown");
    flush();
  }
  const send = (message) => line.send(message);

  function setCamera(given) {
    camera = given;
    own = performance.now();
    set({ camera });
  }
  function undo(again) {
    sendPending();
    own = 0;
    cancelAnimationFrame(flight);
    flight = 0;
    send({ type: again ? "redo" : "undo" });
  }

  const picture = h("canvas", { className: "picture" });
  const errors = h("img", { className: "errors", alt: "", hidden: true });
  const over = overlay((clip) => {
    state.clip = clip;
    set({ clip });
    panels.clip.show(state, data);
    redraw();
  });
  const notices = h("div", { className: "notices", role: "status" });
  const hint = h("div", { className: "tip" });
  const sign = h("div", { className: "sign", role: "status" }, h("span", { className: "wheel" }), h("span", {}, "Drawing …"));
  const stage = h("div", { className: "stage", tabIndex: 0, role: "application" }, picture, errors, over.element, hint, sign, notices);
  stage.setAttribute("aria-label", "Picture. Arrow keys turn it, plus and minus enlarge it, question mark lists all keys.");

  const panels = {
    look: lookPanel(set, () => offered),
    light: lightPanel(set),
    clip: clipPanel(set, () => camera),
    planes: planePanel(set, () => offered, () => camera),
    quality: qualityPanel(set, send),
    measure: measurePanel(set, () => redraw()),
    plan: planPanel(set, send),
  };
  // What is over a picture with a camera and bars.
  const decoration = ({ camera: of, bars }) => ({ camera: of, data: seen || data, bars, shows: state && state.shows, measures: state ? state.measures : [] });
  const redraw = perFrame(() => {
    if (!state) return;
    const { kind, points } = panels.measure;
    over.draw({ ...decoration(drawn), clip: state.clip, clips: panels.clip.element.open, points, aims: kind !== null });
    stage.classList.toggle("aims", kind !== null);
  });
  panels.clip.element.addEventListener("shown", redraw);
  panels.plan.element.addEventListener("toggle", () => panels.plan.draw());

  const title = h("span", { className: "title", role: "heading", "aria-level": "1" }, "sheetsplat");
  const modes = choice([], (mode) => set({ mode }), "How slices become pixels");
  const qualities = choice([["draft", "Draft"], ["good", "Good"], ["best", "Best"]], (quality) => set({ quality }), "Quality");
  const names = choice([], (value) => set({ choice: Number(value) }), "Data");
  const looks = [["+x", [-1, 0, 0]], ["−x", [1, 0, 0]], ["+y", [0, -1, 0]], ["−y", [0, 1, 0]], ["+z", [0, 0, -1]], ["−z", [0, 0, 1]]];
  const lookFrom = (direction) => send({ type: "look", direction, up: null, kind: camera ? camera.kind : null });
  const views = h("div", { className: "views" },
    ...looks.map(([name, direction]) => button(name, () => lookFrom(direction), `Look from ${name}`)),
    button("Reset", () => send({ type: "reset" }), "The first view [R]"));
  const kinds = button("Perspective", () => camera && fly(projectedAs(camera, camera.kind === "perspective" ? "orthographic" : "perspective")), "Perspective or parallel projection [P]");
  const theme = button("◐", () => setTheme(root.dataset.theme === "light" ? "dark" : "light"), "Light or dark");
  const backwards = button("↶", () => undo(false), "Undo [Ctrl+Z]");
  const forwards = button("↷", () => undo(true), "Redo [Ctrl+Y]");
  const bar = h("header", {}, title, names, modes, qualities, views, kinds, h("span", { className: "space" }),
    backwards, forwards,
    button("⤓ As shown", () => save(true), "Save what is seen as PNG: background, bar, directions, scales [S]"),
    button("⤓ Picture", () => save(false), "Save the picture alone as PNG, which says how it was made [Shift+S]"),
    button("⤓ Film", () => film.ask(), "Save a film: a turn, or the times"),
    button("⤓ Scene", () => send({ type: "scene" }), "Save a scene file: sheetsplat render makes the picture of it, sheetsplat view goes on"),
    button("Python", () => send({ type: "code" }), "Python that makes this picture"),
    theme, button("?", () => help(), "Keys and gestures [?]"),
    button("☰", () => { root.classList.toggle("wide"); fit(); }, "Show or hide the panels"));

  const back = choice([["", "Transparent"], ["#000000", "Black"], ["#ffffff", "White"], ["own", "Other …"]], (value) => {
    if (value === "own") backColor.click();
    else set({ background: value || null });
  }, "Background of the picture");
  const backColor = colorField((value) => set({ background: value }), "Background of the picture");
  const behind = colorField((value) => set({ backdrop: value }), "Shown behind what is transparent; not part of the picture");
  const toggles = [["box", "Box with scales"], ["directions", "Directions"], ["bars", "Colour bar"], ["scale", "Scale bar (parallel projection)"]].map(([name, label]) => {
    const box = checkbox(label, (on) => { set({ shows: { ...state.shows, [name]: on } }); redraw(); });
    box.of = name;
    return box;
  });
  const roll = h("div", { className: "buttons" }, button("⟲ 90°", () => fly(rolled(camera, Math.PI / 2)), "Turn the picture left"), button("⟳ 90°", () => fly(rolled(camera, -Math.PI / 2)), "Turn the picture right"));
  const viewPanel = section("View", false, ...toggles, row("Turn", roll), row("Background", back, backColor), row("Behind it", behind));
  const reset = button("As at first", () => set({ automatic: true }), "The look that follows from the data");
  const side = h("aside", {}, panels.look.element, panels.light.element, panels.clip.element, panels.planes.element, viewPanel, panels.measure.element, panels.quality.element, panels.plan.element, h("div", { className: "buttons" }, reset));

  const hover = h("span", { className: "hover" });
  const numbers = h("span", { className: "numbers" });
  const progress = h("span", { className: "progress" });
  const time = h("input", { type: "range", min: 0, max: 0, step: 1, "aria-label": "Time" });
  const timeName = h("span", { className: "time-name" });
  let playing = false;
  const play = button("▶", () => { playing = !playing; play.textContent = playing ? "⏸" : "▶"; if (playing) nextTime(); }, "Play [Space]");
  const times = h("div", { className: "times" }, play, time, timeName);
  time.addEventListener("input", () => set({ time: Number(time.value) }));
  const film = filmDialog((message) => send({ ...message, ...sizeOfPicture() }), () => send({ type: "film_stop" }));
  const foot = h("footer", {}, hover, h("span", { className: "space" }), film.progress, progress, numbers);
  const dialog = h("dialog", {});
  root.classList.add("sheetsplat-viewer");
  root.replaceChildren(bar, h("main", {}, h("div", { className: "left" }, stage, times), side), foot, dialog, film.dialog);

  function nextTime() {
    if (playing && data && data.times.length > 1) set({ time: (state.time + 1) % data.times.length });
  }

  function setTheme(name) {
    root.dataset.theme = name;
    panels.look.editor.redraw();
    try {
      localStorage.setItem("sheetsplat-theme", name);
    } catch {
      // Notebooks may forbid it.
    }
  }

  // Size.

  let settled = 0;
  let asked = [0, 0];
  function sizeNow() {
    const ratio = Math.min(window.devicePixelRatio || 1, 1.5);
    let [width, height] = [stage.clientWidth * ratio, stage.clientHeight * ratio];
    const much = Math.sqrt((width * height) / MOST_PIXELS);
    if (much > 1) [width, height] = [width / much, height / much];
    return [Math.max(16, Math.round(width)), Math.max(16, Math.round(height))];
  }
  function fit() {
    clearTimeout(settled);
    settled = setTimeout(() => {
      const size = sizeNow();
      if (size[0] !== asked[0] || size[1] !== asked[1]) {
        asked = size;
        send({ type: "size", width: size[0], height: size[1] });
      }
      redraw();
    }, SETTLED);
    redraw();
  }
  const observer = new ResizeObserver(fit);
  observer.observe(stage);

  // Frames.

  let drawing = true;
  let impatient = 0;
  function showSign() {
    clearTimeout(impatient);
    stage.setAttribute("aria-busy", String(drawing));
    progress.classList.toggle("busy", drawing);
    sign.hidden = Boolean(drawn.number) || !drawing;
    if (drawing && drawn.number) impatient = setTimeout(() => { sign.hidden = false; }, IMPATIENT);
  }
  function see() {
    if (state && drawn.choice === state.choice && drawn.time === state.time) seen = data;
  }
  function showSteps(message) {
    backwards.disabled = !message.undo;
    forwards.disabled = !message.redo;
  }

  async function showFrame(message, bytes) {
    counts.frames += 1;
    if (message.number <= drawn.number) {
      counts.stale += 1;
      send({ type: "drawn", number: message.number });
      return;
    }
    const image = await createImageBitmap(new Blob([bytes], { type: `image/${message.kind}` }));
    // Another one may have been decoded sooner.
    if (message.number > drawn.number) {
      [picture.width, picture.height] = message.size;
      picture.getContext("2d").drawImage(image, 0, 0);
      drawn = message;
      see();
      if (camera && sameCamera(camera, message.camera)) own = 0;
      if (!camera || (!hands.moving && !flight && (!own || performance.now() - own > OWN))) camera = message.camera;
      kinds.textContent = camera.kind === "perspective" ? "Parallel" : "Perspective";
      const of = message.last ? "" : message.stage ? `stage ${message.stage} of ${message.stages} · ` : "preview · ";
      const error = message.error === null || (message.last && message.error < 1e-4) ? "" : `error about ${shortNumber(message.error)} · `;
      drawing = !message.last;
      showSign();
      showSteps(message);
      numbers.textContent = `${of}${error}${message.size.join(" × ")} · ${Math.round(message.milliseconds)} ms`;
      forgetError();
      redraw();
      if (message.last) {
        hands.ask();
        nextTime();
      }
    } else counts.stale += 1;
    image.close();
    send({ type: "drawn", number: message.number });
  }

  function forgetError() {
    errors.hidden = true;
    if (lastError) URL.revokeObjectURL(lastError);
    lastError = "";
    panels.quality.showError(null);
  }

  // Messages of the session.

  const takes = {
    hello(message) {
      offered = message;
      modes.offer(offered.modes);
    },
    state(message) {
      state = message.state;
      data = message.data;
      see();
      if (!camera) camera = state.camera;
      title.textContent = title.title = data.title;
      modes.show(state.mode);
      qualities.show(state.quality);
      qualities.hidden = data.fixed_quality;
      names.hidden = data.names.length < 2;
      names.offer(data.names.map((name, n) => [String(n), name]));
      names.show(String(state.choice));
      times.hidden = data.times.length < 2;
      film.offer(data.times.length);
      time.max = data.times.length - 1;
      if (!time.matches(":active")) time.value = state.time;
      timeName.textContent = data.times[state.time] || "";
      back.show(state.background === null ? "" : ["#000000", "#ffffff"].includes(state.background) ? state.background : "own");
      backColor.show(state.background || "#808080");
      behind.show(state.backdrop);
      stage.style.background = state.background || state.backdrop;
      for (const panel of Object.values(panels)) panel.show(state, data);
      for (const box of toggles) box.show(state.shows[box.of]);
      showSteps(message);
      redraw();
    },
    drawing() {
      drawing = true;
      showSign();
    },
    frame: showFrame,
    about(message) {
      about = message;
      panels.plan.showPlan(message.plan);
      panels.quality.showPlan(message.plan);
      redraw();
    },
    camera(message) {
      fly(message.camera);
    },
    picked(message) {
      if (message.purpose !== "tell") {
        if (message.value === null) say("There is nothing there");
        else if (message.purpose === "measure") panels.measure.add(message.position);
        else {
          const by = subtract(message.position, camera.target);
          fly({ ...camera, eye: add(camera.eye, by), target: message.position });
        }
        return;
      }
      // The pointer may have gone on.
      if (hands.moving || !hands.pointer || message.x !== hands.pointer[0] || message.y !== hands.pointer[1]) return;
      if (message.value === null) {
        hover.textContent = "";
        hint.classList.remove("shown");
        return;
      }
      const place = message.position.map(shortNumber).join(", ");
      const unitText = message.length_unit ? ` ${message.length_unit}` : "";
      const sample = message.sample ? ` · sample k, j, i = ${message.sample.join(", ")}` : ` · kernel ${message.kernel}`;
      const opacity = message.opacity === null ? "" : ` · opacity ${shortNumber(message.opacity)}`;
      hover.textContent = `${message.label}: ${shortNumber(message.value)} at (${place})${unitText}${opacity}${sample}`;
      hint.textContent = shortNumber(message.value);
      hint.classList.add("shown");
    },
    file: (message, bytes) => keep(message.name, new Blob([bytes], { type: message.kind })),
    async picture(message, bytes) {
      const shown = decoration(message);
      const paint = (context, width, height) => over.paint(context, width, height, shown);
      keep(message.name, await composed(bytes, state.background || state.backdrop, paint));
    },
    code(message) {
      const text = h("pre", {}, message.text);
      open("Python that makes this picture", text, button("Copy", async () => {
        await navigator.clipboard.writeText(message.text);
        say("Copied");
      }));
    },
    filming: (message) => film.show(message.share),
    filmed(message) {
      film.show(null);
      if (message.stopped) say("There is no film");
    },
    measuring(message) {
      panels[message.what === "error" ? "quality" : "plan"].busy(true);
    },
    measured(message) {
      panels[message.what === "error" ? "quality" : "plan"].busy(false);
      if (message.stopped) say("Measuring was stopped by a change");
    },
    costs(message) {
      panels.plan.showCosts(message.costs);
    },
    error_map(message, bytes) {
      panels.quality.showError(message);
      lastError = URL.createObjectURL(new Blob([bytes], { type: "image/png" }));
      errors.src = lastError;
    },
    warning(message) {
      say(message.text, "warning");
    },
    error(message) {
      counts.errors += 1;
      drawing = false;
      showSign();
      say(message.text, "error");
    },
    closed() {
      say("The viewer was closed in Python.", "error");
      root.classList.add("lost");
    },
  };
  root.addEventListener("errormap", (event) => {
    errors.hidden = !event.detail;
  });

  function keep(name, blob) {
    const link = h("a", { href: URL.createObjectURL(blob), download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 10000);
    say(`Saved ${name}`);
  }

  function say(text, kind = "info") {
    const known = [...notices.children].find((one) => one.dataset.text === text);
    if (known) known.remove();
    const note = h("div", { className: `notice ${kind}` }, h("span", {}, text), button("×", () => note.remove(), "Close"));
    note.dataset.text = text;
    notices.append(note);
    while (notices.children.length > 4) notices.firstChild.remove();
    setTimeout(() => note.remove(), kind === "info" ? 2500 : 12000);
  }

  function open(heading, ...parts) {
    dialog.replaceChildren(h("h2", {}, heading), ...parts, button("Close", () => dialog.close()));
    dialog.showModal();
  }

  function help() {
    open("Keys and gestures", h("table", { className: "settings" }, ...keyTable(offered.modes.length).map(([key, what]) => h("tr", {}, h("td", {}, key), h("td", {}, what)))));
  }

  function sizeOfPicture() {
    const [width, height] = drawn.camera ? drawn.size : sizeNow();
    return { width, height };
  }
  const save = (shown) => send({ type: "save", ...sizeOfPicture(), shown });

  /** Goes to a camera on a short way, so that one sees where. */
  function fly(goal) {
    if (!camera || camera.kind !== goal.kind) {
      setCamera(goal);
      return;
    }
    const first = camera;
    const began = performance.now();
    cancelAnimationFrame(flight);
    const step = (now) => {
      const share = Math.min((now - began) / FLIGHT, 1);
      const smooth = share * share * (3 - 2 * share);
      flight = share < 1 ? requestAnimationFrame(step) : 0;
      setCamera(share < 1 ? between(first, goal, smooth) : goal);
    };
    flight = requestAnimationFrame(step);
  }

  // Hands.

  const hands = listenToHands(stage, {
    camera: () => camera,
    setCamera,
    began() {
      cancelAnimationFrame(flight);
      flight = 0;
      hint.classList.remove("shown");
    },
    hit: over.hit,
    near: over.near,
    aims: () => panels.measure.kind,
    pick: (share, purpose) => send({ type: "pick", ...share, purpose }),
    rests([x, y]) {
      hint.style.left = `${Math.min(x + 14, stage.clientWidth - 60)}px`;
      hint.style.top = `${y + 14}px`;
      hint.classList.remove("shown");
    },
    leaves() {
      hint.classList.remove("shown");
      hover.textContent = "";
    },
  });

  const forgetKeys = listenToKeys(keys, root, {
    camera: () => camera,
    setCamera,
    lookFrom,
    undo,
    mode: (n) => offered.modes[n] && set({ mode: offered.modes[n][0] }),
    keys: {
      r: () => send({ type: "reset" }),
      p: () => kinds.click(),
      s: (alone) => save(!alone),
      b: () => toggles[0].firstChild.click(),
      d: () => panels.measure.take("distance"),
      a: () => panels.measure.take("angle"),
      escape: () => panels.measure.take(null),
      enter: () => hands.pick(panels.measure.kind ? "measure" : "centre"),
      "?": () => help(),
      h: () => help(),
      " ": () => play.click(),
    },
  });
  // In a notebook keys belong to the cells until the focus is here.
  stage.addEventListener("pointerenter", () => {
    if (document.activeElement === document.body) stage.focus({ preventScroll: true });
  });

  // The line to the session.

  const line = connect({
    open() {
      root.classList.remove("lost");
      film.show(null);
      // Numbers of frames begin anew where the session did.
      drawn = { ...drawn, number: 0 };
      drawing = true;
      showSign();
      asked = sizeNow();
      send({ type: "hello", width: asked[0], height: asked[1] });
    },
    message(message, bytes) {
      const take = takes[message.type];
      if (take) take(message, bytes);
    },
    lost(text) {
      root.classList.add("lost");
      hover.textContent = text;
    },
  });
  let wanted = null;
  try {
    wanted = localStorage.getItem("sheetsplat-theme");
  } catch {
    // Notebooks may forbid it.
  }
  setTheme(wanted || (window.matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"));

  return {
    close() {
      observer.disconnect();
      forgetKeys();
      line.close();
    },
    // For tests: what is shown now.
    get view() {
      return { state, data, camera, drawn, counts, about, handles: over.handles(), editor: panels.look.editor };
    },
    set,
  };
}
