// The editor of a transfer function: opacities over the histogram, colours in the bar below.

const EDITOR_HEIGHT = 150;
const BAR_HEIGHT = 18;
const HANDLE = 6;
// Opacities are small: their roots leave room for them.
const raised = (opacity) => Math.sqrt(Math.min(Math.max(opacity, 0), 1));

/** Returns an element; `change` gets what the session takes as changes of a look. */
function transferEditor(change) {
  const canvas = h("canvas", { className: "editor", tabIndex: 0, title: "", role: "application" });
  canvas.setAttribute("aria-label", "Transfer function: opacity over the histogram, colours below. Arrow keys move a point, page keys choose one, Insert adds one, Delete removes it, Enter changes a colour.");
  const tip = h("div", { className: "editor-tip" });
  const color = h("input", { type: "color", className: "hidden", tabIndex: -1, "aria-label": "Colour of the point" });
  const element = h("div", { className: "editor-box" }, canvas, tip, color);
  let look = null;
  let data = null;
  let span = [0, 1];
  let chosen = null; // ["opacity" or "color", number]
  let held = false;

  const x = (value) => 8 + ((value - span[0]) / (span[1] - span[0])) * (canvas.clientWidth - 16);
  const value = (at) => span[0] + ((at - 8) / (canvas.clientWidth - 16)) * (span[1] - span[0]);
  const y = (opacity) => 8 + (1 - raised(opacity)) * (EDITOR_HEIGHT - 16);
  const opacity = (at) => Math.min(Math.max(1 - (at - 8) / (EDITOR_HEIGHT - 16), 0), 1) ** 2;

  function draw() {
    const { context, width } = fitted(canvas);
    if (!look || !width) return;
    const style = getComputedStyle(canvas);
    const ink = style.color;
    drawHistogram(context, style.getPropertyValue("--faint"));
    context.font = "10px system-ui, sans-serif";
    for (const level of [0.01, 0.1, 0.5, 1]) {
      context.globalAlpha = 0.18;
      context.fillStyle = ink;
      context.fillRect(8, y(level), width - 16, 1);
      context.globalAlpha = 0.6;
      context.fillText(String(level), 9, y(level) + 10);
    }
    context.globalAlpha = 1;
    const points = look.opacity;
    const path = new Path2D();
    path.moveTo(8, y(points[0][1]));
    // The root bends what is straight: each line in parts.
    points.forEach(([at, height], n) => {
      const [before, from] = n ? points[n - 1] : [at, height];
      for (let part = 1; part <= 12; part += 1) {
        const share = part / 12;
        path.lineTo(x(before + (at - before) * share), y(from + (height - from) * share));
      }
    });
    path.lineTo(width - 8, y(points[points.length - 1][1]));
    const filled = new Path2D(path);
    filled.lineTo(width - 8, y(0));
    filled.lineTo(8, y(0));
    const shade = context.createLinearGradient(x(look.range[0]), 0, x(look.range[1]), 0);
    look.ramp.forEach((one, n) => shade.addColorStop(n / (look.ramp.length - 1), one));
    context.fillStyle = shade;
    context.globalAlpha = 0.35;
    context.fill(filled);
    context.globalAlpha = 1;
    context.strokeStyle = ink;
    context.lineWidth = 1.5;
    context.stroke(path);
    context.fillStyle = shade;
    context.fillRect(8, EDITOR_HEIGHT, width - 16, BAR_HEIGHT);
    points.forEach(([at, height], n) => dot(context, x(at), y(height), isChosen("opacity", n), ink, null));
    look.colors.forEach(([at, one], n) => {
      dot(context, x(at), EDITOR_HEIGHT + BAR_HEIGHT, isChosen("color", n), ink, one);
    });
    context.fillStyle = ink;
    context.globalAlpha = 0.8;
    const marks = ticks(span[0], span[1], 4);
    for (const mark of marks) {
      const text = shortNumber(mark);
      const wide = context.measureText(text).width;
      context.fillText(text, Math.min(Math.max(x(mark) - wide / 2, 0), width - wide), EDITOR_HEIGHT + BAR_HEIGHT + 20);
    }
    context.globalAlpha = 1;
  }

  function drawHistogram(context, fill) {
    if (!data) return;
    const most = Math.log1p(Math.max(...data.counts));
    const width = (data.high - data.low) / data.counts.length;
    context.fillStyle = fill;
    data.counts.forEach((count, n) => {
      const left = x(data.low + n * width);
      const right = x(data.low + (n + 1) * width);
      const height = (Math.log1p(count) / (most || 1)) * (EDITOR_HEIGHT - 16);
      context.fillRect(left, EDITOR_HEIGHT - 8 - height, Math.max(right - left, 0.6), height);
    });
  }

  function dot(context, left, top, selected, ink, fill) {
    context.beginPath();
    context.arc(left, top, selected ? HANDLE : HANDLE - 1.5, 0, 2 * Math.PI);
    context.fillStyle = fill || (selected ? ink : getComputedStyle(canvas).backgroundColor);
    context.fill();
    context.strokeStyle = ink;
    context.lineWidth = selected ? 2 : 1.5;
    context.stroke();
  }

  const isChosen = (kind, n) => chosen && chosen[0] === kind && chosen[1] === n;

  function near(event) {
    const found = [];
    look.opacity.forEach(([at, height], n) => found.push(["opacity", n, x(at), y(height)]));
    look.colors.forEach(([at], n) => found.push(["color", n, x(at), EDITOR_HEIGHT + BAR_HEIGHT]));
    const away = ([, , left, top]) => Math.hypot(left - event.offsetX, top - event.offsetY);
    const best = found.sort((a, b) => away(a) - away(b))[0];
    return best && away(best) < 2.2 * HANDLE ? [best[0], best[1]] : null;
  }

  function send(kind) {
    if (kind === "opacity") change({ opacity: look.opacity });
    else {
      recolor();
      change({ colors: look.colors.map(([at, one]) => [at, ...partsOf(one)]) });
    }
    draw();
  }

  /** Makes the ramp of the colours again, and the values that it goes over. */
  function recolor() {
    const points = look.colors;
    look.range = [points[0][0], points[points.length - 1][0]];
    look.ramp = look.ramp.map((_, n) => {
      const at = look.range[0] + ((look.range[1] - look.range[0]) * n) / (look.ramp.length - 1);
      const next = Math.max(1, points.findIndex(([place]) => place >= at));
      const [from, to] = [points[next - 1], points[Math.min(next, points.length - 1)]];
      const share = to[0] > from[0] ? Math.min(Math.max((at - from[0]) / (to[0] - from[0]), 0), 1) : 0;
      const [first, second] = [partsOf(from[1]), partsOf(to[1])];
      return hexOf(first.map((part, k) => part + (second[k] - part) * share));
    });
  }

  const listOf = (kind) => (kind === "opacity" ? look.opacity : look.colors);

  function colorAt(at) {
    const share = (at - look.range[0]) / (look.range[1] - look.range[0] || 1);
    return look.ramp[Math.round(Math.min(Math.max(share, 0), 1) * (look.ramp.length - 1))];
  }

  function insert(kind, point) {
    const list = listOf(kind);
    const n = list.findIndex(([at]) => at > point[0]);
    const place = n < 0 ? list.length : n;
    list.splice(place, 0, point);
    chosen = [kind, place];
    send(kind);
  }

  function remove() {
    if (!chosen || listOf(chosen[0]).length < 3) return;
    listOf(chosen[0]).splice(chosen[1], 1);
    const kind = chosen[0];
    chosen = null;
    send(kind);
  }

  function say(event) {
    const found = chosen && listOf(chosen[0])[chosen[1]];
    if (!found) return;
    tip.textContent = shortNumber(found[0]) + (chosen[0] === "opacity" ? `: opacity ${shortNumber(found[1])}` : "");
    tip.style.left = `${Math.min(x(found[0]), canvas.clientWidth - 90)}px`;
    tip.classList.toggle("shown", Boolean(event));
  }

  dragging(canvas, {
    start(event) {
      if (!look || event.button === 2) return null;
      chosen = near(event);
      canvas.focus({ preventScroll: true });
      draw();
      held = Boolean(chosen);
      return chosen;
    },
    move(event) {
      const [kind, n] = chosen;
      const list = listOf(kind);
      const low = n ? list[n - 1][0] : -Infinity;
      const high = n + 1 < list.length ? list[n + 1][0] : Infinity;
      list[n][0] = Math.min(Math.max(value(event.offsetX), low), high);
      if (kind === "opacity") list[n][1] = opacity(event.offsetY);
      send(kind);
      say(event);
    },
    end() {
      held = false;
      say(null);
      reach();
      draw();
    },
  });
  canvas.addEventListener("dblclick", (event) => {
    if (!look) return;
    const found = near(event);
    if (found && found[0] === "color") {
      chosen = found;
      color.value = look.colors[found[1]][1];
      color.click();
    } else if (!found && event.offsetY > EDITOR_HEIGHT) {
      insert("color", [value(event.offsetX), colorAt(value(event.offsetX))]);
    } else if (!found) {
      insert("opacity", [value(event.offsetX), opacity(event.offsetY)]);
    }
  });
  canvas.addEventListener("contextmenu", (event) => {
    event.preventDefault();
    chosen = near(event);
    remove();
  });
  // Without a pointer the first point is the one to begin with.
  canvas.addEventListener("focus", () => {
    if (look && !chosen && canvas.matches(":focus-visible")) {
      chosen = ["opacity", 0];
      draw();
    }
  });
  const order = () => ["opacity", "color"].flatMap((kind) => listOf(kind).map((_, n) => [kind, n]));
  canvas.addEventListener("keydown", (event) => {
    if (!chosen || !look || event.ctrlKey || event.metaKey) return;
    const [kind, n] = chosen;
    const list = listOf(kind);
    const step = (event.shiftKey ? 10 : 1) * 0.005;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (event.key === "Delete" || event.key === "Backspace") remove();
    else if (event.key === "PageDown" || event.key === "PageUp") {
      const all = order();
      const now = all.findIndex(([one, k]) => one === kind && k === n);
      chosen = all[(now + (event.key === "PageDown" ? 1 : all.length - 1)) % all.length];
      say(event);
    } else if (event.key === "Insert" && n + 1 < list.length) {
      const at = (list[n][0] + list[n + 1][0]) / 2;
      insert(kind, kind === "color" ? [at, colorAt(at)] : [at, (list[n][1] + list[n + 1][1]) / 2]);
    } else if (event.key === "Enter" && kind === "color") {
      color.value = list[n][1];
      color.click();
    }
    else if (event.key in moves) {
      const [across, upwards] = moves[event.key];
      const low = n ? list[n - 1][0] : -Infinity;
      const high = n + 1 < list.length ? list[n + 1][0] : Infinity;
      list[n][0] = Math.min(Math.max(list[n][0] + across * (span[1] - span[0]), low), high);
      if (kind === "opacity") {
        list[n][1] = Math.min(Math.max(raised(list[n][1]) + upwards, 0), 1) ** 2;
      }
      send(kind);
    } else return;
    event.preventDefault();
    event.stopPropagation();
    draw();
  });
  color.addEventListener("input", () => {
    if (!chosen || chosen[0] !== "color") return;
    look.colors[chosen[1]][1] = color.value;
    send("color");
  });
  new ResizeObserver(draw).observe(canvas);

  /** Lets the axis reach over the histogram and all points. */
  function reach() {
    const values = [...look.opacity, ...look.colors].map(([at]) => at);
    const low = Math.min(data ? data.low : Infinity, ...values);
    const high = Math.max(data ? data.high : -Infinity, ...values);
    span = low < high ? [low, high] : [low - 1, high + 1];
  }

  element.chosenColor = () => (chosen && chosen[0] === "color" ? look.colors[chosen[1]][1] : null);
  element.show = (given, histogram) => {
    if (held || !given) return;
    look = structuredClone(given);
    data = histogram;
    if (chosen && chosen[1] >= listOf(chosen[0]).length) chosen = null;
    reach();
    draw();
  };
  element.redraw = draw;
  element.point = (kind, n) => {
    const [at, second] = listOf(kind)[n];
    const box = canvas.getBoundingClientRect();
    return [box.left + x(at), box.top + (kind === "opacity" ? y(second) : EDITOR_HEIGHT + BAR_HEIGHT)];
  };
  return element;
}
