// The viewer: the picture, what is over and beside it, and what hands do with it.

// Pictures follow the window when it has not changed for so many milliseconds.
const SETTLED = 120;
const FLIGHT = 280;
const MOST_PIXELS = 2600 * 1600;

/**
 * Shows a session within an element. `connect(handlers)` returns {send(message), close()}; it calls handlers.open(),
 * handlers.message(message, bytes) and handlers.lost(text). Returns what tests and widgets need.
 */
function mount(root, connect) {
  let offered = { modes: [], colormaps: {}, words: [], presets: [] };
  let state = null;
  let data = null;
  let camera = null; // The one that hands move; the picture's own may be older.
  let drawn = { number: 0, camera: null, size: [1, 1] };
  let pending = {};
  let moving = false;
  let flight = 0;
  let about = { bars: [], plan: null };
  let lastError = "";
  const counts = { frames: 0, dropped: 0, stale: 0, errors: 0 };
  const shows = { box: false, directions: true, bars: true, scale: false };

  // What hands change goes out once a frame of the screen, the newest of each kind.
  const flush = perFrame(() => {
    if (!Object.keys(pending).length) return;
    line.send({ type: "set", changes: pending });
    pending = {};
  });
  function set(changes) {
    if (!state) return;
    for (const [name, value] of Object.entries(changes)) {
      pending[name] = name === "look" && pending.look && pending.look.group === value.group ? { ...pending.look, ...value } : value;
      if (name in state && name !== "look") state[name] = value;
    }
    forgetError();
    flush();
  }
  const send = (message) => line.send(message);

  function setCamera(given) {
    camera = given;
    set({ camera });
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
  const stage = h("div", { className: "stage", tabIndex: 0 }, picture, errors, over.element, hint, notices);
  stage.setAttribute("aria-label", "Picture. Arrow keys turn it, plus and minus enlarge it, question mark lists all keys.");

  const panels = {
    look: lookPanel(set, () => offered),
    light: lightPanel(set),
    clip: clipPanel(set, () => camera),
    quality: qualityPanel(set, send),
    plan: planPanel(set, send),
  };
  const redraw = perFrame(() => {
    over.draw({ camera: drawn.camera, data, bars: about.bars, shows, clip: state && state.clip, clips: panels.clip.element.open && state });
  });
  panels.clip.element.addEventListener("shown", redraw);
  panels.plan.element.addEventListener("toggle", () => panels.plan.draw());

  const title = h("span", { className: "title" }, "sheetsplat");
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
  const bar = h("header", {}, title, names, modes, qualities, views, kinds, h("span", { className: "space" }),
    button("⤓ Picture", () => save(), "Save the picture as PNG, which says how it was made [S]"),
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
    const box = checkbox(label, (on) => { shows[name] = on; redraw(); });
    box.show(shows[name]);
    return box;
  });
  const roll = h("div", { className: "buttons" }, button("⟲ 90°", () => fly(rolled(camera, Math.PI / 2)), "Turn the picture left"), button("⟳ 90°", () => fly(rolled(camera, -Math.PI / 2)), "Turn the picture right"));
  const viewPanel = section("View", false, ...toggles, row("Turn", roll), row("Background", back, backColor), row("Behind it", behind));
  const reset = button("Undo all changes", () => set({ automatic: true }), "The look that follows from the data");
  const side = h("aside", {}, panels.look.element, panels.light.element, panels.clip.element, viewPanel, panels.quality.element, panels.plan.element, h("div", { className: "buttons" }, reset));

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
      if (!moving && !flight) camera = message.camera;
      kinds.textContent = camera.kind === "perspective" ? "Parallel" : "Perspective";
      const of = message.last ? "" : message.stage ? `stage ${message.stage} of ${message.stages} · ` : "preview · ";
      const error = message.error === null || (message.last && message.error < 1e-4) ? "" : `error about ${shortNumber(message.error)} · `;
      progress.classList.toggle("busy", !message.last);
      numbers.textContent = `${of}${error}${message.size.join(" × ")} · ${Math.round(message.milliseconds)} ms`;
      forgetError();
      redraw();
      if (message.last) nextTime();
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
      redraw();
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
      if (message.value === null) {
        hover.textContent = "";
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
    file(message, bytes) {
      const link = h("a", { href: URL.createObjectURL(new Blob([bytes], { type: message.kind })), download: message.name });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 10000);
      say(`Saved ${message.name}`);
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
    const keys = [
      ["Drag, one finger, arrow keys", "turn"],
      ["Right or middle drag, Shift and drag, two fingers, Shift and arrows", "move"],
      ["Wheel, two fingers, + and −", "enlarge"],
      ["Ctrl and drag, twist of two fingers, Q and E", "roll"],
      ["Double-click", "turn about what is there"],
      ["R", "first view"],
      ["X, Y, Z; with Shift from the other side", "look along an axis"],
      ["P", "perspective or parallel projection"],
      [`1 … ${offered.modes.length}`, "mode"],
      ["B", "box with scales"],
      ["S", "save the picture"],
      ["Space", "play"],
    ];
    open("Keys and gestures", h("table", { className: "settings" }, ...keys.map(([key, what]) => h("tr", {}, h("td", {}, key), h("td", {}, what)))));
  }

  function sizeOfPicture() {
    const [width, height] = drawn.camera ? drawn.size : sizeNow();
    return { width, height };
  }
  const save = () => send({ type: "save", ...sizeOfPicture() });

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

  const fingers = new Map();
  const pointOf = (event) => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  let grip = null;
  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("pointerdown", (event) => {
    if (!camera || event.target.closest(".notices")) return;
    stage.focus({ preventScroll: true });
    stage.setPointerCapture(event.pointerId);
    const point = pointOf(event);
    fingers.set(event.pointerId, point);
    cancelAnimationFrame(flight);
    flight = 0;
    moving = true;
    hint.classList.remove("shown");
    grip = fingers.size === 1 && event.button === 0 ? over.hit(point) : null;
  });
  stage.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    const point = pointOf(event);
    if (!before) {
      pointAt(point);
      return;
    }
    if (grip) {
      grip.move(point);
      return;
    }
    const [dx, dy] = [point[0] - before[0], point[1] - before[1]];
    const high = stage.clientHeight;
    if (fingers.size === 1) {
      if (event.buttons & 6 || event.shiftKey) setCamera(panned(camera, dx / high, -dy / high));
      else if (event.ctrlKey || event.metaKey) {
        const middle = [stage.clientWidth / 2, high / 2];
        const angle = (at) => Math.atan2(middle[1] - at[1], at[0] - middle[0]);
        setCamera(rolled(camera, angle(point) - angle(before)));
      } else setCamera(orbited(camera, (-dx / high) * Math.PI, (dy / high) * Math.PI));
    } else if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const spread = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]) || 1;
      const angle = (at) => Math.atan2(other[1] - at[1], at[0] - other[0]);
      let next = panned(camera, dx / 2 / high, -dy / 2 / high);
      const middle = [(point[0] + other[0]) / 2, (point[1] + other[1]) / 2];
      next = zoomed(next, spread(point) / spread(before), (middle[0] - stage.clientWidth / 2) / high, (high / 2 - middle[1]) / high);
      setCamera(rolled(next, angle(point) - angle(before)));
    }
    fingers.set(event.pointerId, point);
  });
  const released = (event) => {
    fingers.delete(event.pointerId);
    if (fingers.size) return;
    if (grip) grip.end();
    grip = null;
    moving = false;
  };
  stage.addEventListener("pointerup", released);
  stage.addEventListener("pointercancel", released);
  stage.addEventListener("pointerleave", () => {
    hint.classList.remove("shown");
    hover.textContent = "";
  });
  stage.addEventListener("wheel", (event) => {
    if (!camera) return;
    event.preventDefault();
    const [x, y] = pointOf(event);
    const high = stage.clientHeight;
    const lines = event.deltaMode === 1 ? 33 : event.deltaMode === 2 ? high : 1;
    const by = Math.min(Math.max(-event.deltaY * lines, -240), 240);
    setCamera(zoomed(camera, Math.exp(by * 0.0016), (x - stage.clientWidth / 2) / high, (high / 2 - y) / high));
  }, { passive: false });
  let centring = false;
  stage.addEventListener("dblclick", (event) => {
    const [x, y] = pointOf(event);
    centring = true;
    send({ type: "pick", x: x / stage.clientWidth, y: y / stage.clientHeight });
  });
  const picked = takes.picked;
  takes.picked = (message) => {
    picked(message);
    if (!centring) return;
    centring = false;
    if (message.value === null) return;
    const by = subtract(message.position, camera.target);
    fly({ ...camera, eye: add(camera.eye, by), target: message.position });
  };

  let pointed = 0;
  function pointAt(point) {
    stage.style.cursor = over.near(point) ? "grab" : "";
    hint.style.left = `${Math.min(point[0] + 14, stage.clientWidth - 60)}px`;
    hint.style.top = `${point[1] + 14}px`;
    clearTimeout(pointed);
    hint.classList.remove("shown");
    pointed = setTimeout(() => {
      if (drawn.last) send({ type: "pick", x: point[0] / stage.clientWidth, y: point[1] / stage.clientHeight });
    }, 60);
  }

  const turn = Math.PI / 24;
  const held = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  stage.addEventListener("keydown", (event) => {
    if (!camera || event.ctrlKey || event.metaKey || event.altKey) return;
    const axis = { x: 0, y: 1, z: 2 }[event.key.toLowerCase()];
    const key = event.key.toLowerCase();
    if (event.key in held) {
      const [across, upwards] = held[event.key];
      setCamera(event.shiftKey ? panned(camera, -across * 0.05, upwards * 0.05) : orbited(camera, -across * turn, upwards * turn));
    } else if (key === "+" || key === "=") setCamera(zoomed(camera, 1.15));
    else if (key === "-" || key === "_") setCamera(zoomed(camera, 1 / 1.15));
    else if (key === "q" || key === "e") setCamera(rolled(camera, key === "q" ? turn : -turn));
    else if (key === "r") send({ type: "reset" });
    else if (axis !== undefined) lookFrom([0, 1, 2].map((n) => (n === axis ? (event.shiftKey ? 1 : -1) : 0)));
    else if (key === "p") kinds.click();
    else if (key === "s") save();
    else if (key === "b") toggles[0].firstChild.click();
    else if (key === "?" || key === "h") help();
    else if (key === " ") play.click();
    else if (key >= "1" && key <= "9" && offered.modes[key - 1]) set({ mode: offered.modes[key - 1][0] });
    else return;
    event.preventDefault();
  });

  // The line to the session.

  const line = connect({
    open() {
      root.classList.remove("lost");
      film.show(null);
      // Numbers of frames begin anew where the session did.
      drawn = { ...drawn, number: 0 };
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
      line.close();
    },
    // For tests: what is shown now.
    get view() {
      return { state, data, camera, drawn, counts, about, handles: over.handles(), editor: panels.look.editor };
    },
    set,
  };
}
