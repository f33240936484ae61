// What is drawn over the picture: the box of the data with its scales, directions, colour bars, and handles to clip.

const AXES = [
  ["x", "#f0703c"],
  ["y", "#3cc46c"],
  ["z", "#4c9cff"],
];
const EDGE_ENDS = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((corner) =>
  [1, 2, 4].filter((bit) => !(corner & bit)).map((bit) => [corner, corner | bit]),
);
const REACH = 11;
// Names beside a bar of labels: pixels between two, and letters of one.
const NAME_HEIGHT = 13;
const NAME_LETTERS = 24;

const cornerOf = (bounds, number) => [0, 1, 2].map((axis) => bounds[(number >> axis) & 1][axis]);
const middleOf = (bounds) => scaled(add(bounds[0], bounds[1]), 0.5);

/** Returns {element, draw, hit}: `draw(view)` draws; `hit(point)` returns a handle, {move(point), end()}, or null. */
function overlay(change) {
  const element = h("canvas", { className: "overlay" });
  let view = null;
  let handles = [];
  let active = null;

  function draw(given) {
    view = given;
    const { context, width, height } = fitted(element);
    handles = [];
    if (!view.camera || !view.data || !width) return;
    const place = decorate(context, width, height);
    if (view.clips) drawClip(context, place);
    if (view.points) drawPoints(context, place, view.points, "#ffd24a");
    if (view.aims) drawAim(context, width, height);
  }

  /** Draws what a saved picture has, too, and returns where points of the world are. */
  function decorate(context, width, height) {
    // Shadows around letters and lines keep them readable on any picture.
    context.font = "11px system-ui, sans-serif";
    context.lineJoin = "round";
    const size = [width, height];
    const place = (point) => placeOf(view.camera, size, point);
    if (view.shows.box) drawBox(context, place);
    for (const points of view.measures) drawMeasure(context, place, points);
    if (view.shows.directions) drawDirections(context, height);
    if (view.shows.bars) drawBars(context, width, height);
    if (view.shows.scale && view.camera.kind === "orthographic") drawScale(context, width, height);
    return place;
  }

  /** Draws over a picture of another size what is shown over this one, which has `width` CSS pixels. */
  function paint(context, width, height, given) {
    const kept = view;
    view = given;
    const scale = width / element.clientWidth;
    context.save();
    context.scale(scale, scale);
    decorate(context, element.clientWidth, height / scale);
    context.restore();
    view = kept;
  }

  function drawPoints(context, place, points, color) {
    for (const at of points.map(place)) {
      if (!at) continue;
      context.beginPath();
      context.arc(at[0], at[1], 4, 0, 2 * Math.PI);
      context.fillStyle = color;
      context.fill();
      context.lineWidth = 1.5;
      context.strokeStyle = "rgba(0,0,0,0.8)";
      context.stroke();
    }
  }

  function drawMeasure(context, place, points) {
    const places = points.map(place);
    places.slice(1).forEach((at, n) => line(context, places[n], at, "#ffd24a", 1.5));
    drawPoints(context, place, points, "#ffd24a");
    if (places.some((at) => !at)) return;
    const at = points.length === 2 ? [(places[0][0] + places[1][0]) / 2, (places[0][1] + places[1][1]) / 2] : places[1];
    context.font = "600 13px system-ui, sans-serif";
    write(context, measureText(points, view.data.length_unit), at[0] + 10, at[1] - 12, "left", "#ffd24a");
    context.font = "11px system-ui, sans-serif";
  }

  function drawAim(context, width, height) {
    const [x, y] = [width / 2, height / 2];
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      line(context, [x + 4 * dx, y + 4 * dy], [x + 12 * dx, y + 12 * dy], "#ffd24a", 1.5);
    }
  }

  function line(context, from, to, color, wide = 1) {
    if (!from || !to) return;
    context.lineCap = "round";
    for (const [style, thick] of [["rgba(0,0,0,0.5)", wide + 2], [color, wide]]) {
      context.strokeStyle = style;
      context.lineWidth = thick;
      context.beginPath();
      context.moveTo(from[0], from[1]);
      context.lineTo(to[0], to[1]);
      context.stroke();
    }
  }

  function write(context, text, left, top, align = "left", color = "#fff") {
    context.textAlign = align;
    context.textBaseline = "middle";
    context.lineWidth = 3;
    context.strokeStyle = "rgba(0,0,0,0.75)";
    context.strokeText(text, left, top);
    context.fillStyle = color;
    context.fillText(text, left, top);
  }

  function drawBox(context, place) {
    const bounds = view.data.box;
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((n) => place(cornerOf(bounds, n)));
    for (const [from, to] of EDGE_ENDS) line(context, corners[from], corners[to], "rgba(255,255,255,0.45)");
    const middle = place(middleOf(bounds));
    if (!middle || corners.some((one) => !one)) return;
    AXES.forEach(([name, color], axis) => {
      const edges = EDGE_ENDS.filter(([from, to]) => to - from === 1 << axis);
      // The outermost edge below, for upright axes to the left.
      const upright = Math.abs(corners[1 << axis][1] - corners[0][1]) > Math.abs(corners[1 << axis][0] - corners[0][0]);
      const rank = ([from, to]) =>
        upright ? -(corners[from][0] + corners[to][0]) : corners[from][1] + corners[to][1];
      const [from, to] = edges.sort((a, b) => rank(b) - rank(a))[0];
      const [a, b] = [corners[from], corners[to]];
      const long = Math.hypot(b[0] - a[0], b[1] - a[1]);
      if (long < 40) return;
      const half = [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2];
      const out = [half[0] - middle[0], half[1] - middle[1]];
      const far = Math.hypot(out[0], out[1]) || 1;
      const beside = (at, by) => [at[0] + (out[0] / far) * by, at[1] + (out[1] / far) * by];
      const align = out[0] / far < -0.4 ? "right" : out[0] / far > 0.4 ? "left" : "center";
      line(context, a, b, color, 1.5);
      for (const mark of ticks(bounds[0][axis], bounds[1][axis], long / 70)) {
        const point = cornerOf(bounds, from);
        point[axis] = mark;
        const at = place(point);
        line(context, at, beside(at, 4), color);
        write(context, shortNumber(mark), ...beside(at, 12), align);
      }
      const unitText = view.data.length_unit ? ` [${view.data.length_unit}]` : "";
      write(context, name + unitText, ...beside(half, 30), align, color);
    });
  }

  function drawDirections(context, height) {
    const { right, up, back } = axesOf(view.camera);
    const middle = [46, height - 46];
    const order = [0, 1, 2].sort((a, b) => back[a] - back[b]);
    for (const axis of order) {
      const [name, color] = AXES[axis];
      const tip = [middle[0] + 28 * right[axis], middle[1] - 28 * up[axis]];
      line(context, middle, tip, color, 2.5);
      write(context, name, middle[0] + 38 * right[axis], middle[1] - 38 * up[axis], "center", color);
    }
  }

  function drawBars(context, width, height) {
    const high = Math.min(220, height * 0.5);
    view.bars.forEach((bar, n) => {
      const left = width - 74 - 92 * n;
      const top = (height - high) / 2;
      const shade = context.createLinearGradient(0, top + high, 0, top);
      bar.colors.forEach((color, k) => shade.addColorStop(k / Math.max(bar.colors.length - 1, 1), color));
      context.fillStyle = shade;
      context.fillRect(left, top, 14, high);
      // Labels have a part each.
      const part = high / bar.colors.length;
      (bar.names.length ? bar.colors : []).forEach((color, k) => {
        context.fillStyle = color;
        context.fillRect(left, top + high - (k + 1) * part, 14, part);
      });
      context.lineWidth = 1;
      context.strokeStyle = "rgba(255,255,255,0.6)";
      context.strokeRect(left - 0.5, top - 0.5, 15, high + 1);
      const share = (number) =>
        bar.log
          ? (Math.log(number) - Math.log(bar.low)) / (Math.log(bar.high) - Math.log(bar.low))
          : (number - bar.low) / (bar.high - bar.low);
      // As many names as have room, from the top.
      let free = -Infinity;
      for (const [place, name] of [...bar.names].reverse()) {
        const at = top + high * (1 - share(place));
        if (at < free) continue;
        free = at + NAME_HEIGHT;
        const letters = [...name];
        const text = letters.length > NAME_LETTERS ? letters.slice(0, NAME_LETTERS).join("") + "…" : name;
        write(context, text, left - 8, at, "right");
      }
      const marks = bar.names.length
        ? []
        : bar.log
        ? ticks(Math.log10(bar.low), Math.log10(bar.high), 5).filter(Number.isInteger).map((power) => 10 ** power)
        : ticks(bar.low, bar.high, high / 45);
      for (const mark of marks) {
        const at = top + high * (1 - share(mark));
        context.fillStyle = "rgba(255,255,255,0.8)";
        context.fillRect(left + 14, at - 0.5, 4, 1);
        write(context, shortNumber(mark), left + 21, at);
      }
      for (const mark of bar.marks) {
        const at = top + high * (1 - share(mark));
        line(context, [left - 3, at], [left + 17, at], "#fff", 1.5);
      }
      write(context, bar.label, Math.min(left + 40, width - 6), top - 14, "right");
    });
  }

  function drawScale(context, width, height) {
    const perPixel = worldHeight(view.camera) / height;
    const most = 0.25 * width * perPixel;
    const power = 10 ** Math.floor(Math.log10(most));
    const long = [5, 2, 1].find((factor) => factor * power <= most) * power;
    const right = width - 20;
    line(context, [right - long / perPixel, height - 18], [right, height - 18], "#fff", 2.5);
    write(context, `${shortNumber(long)} ${view.data.length_unit || ""}`, right, height - 30, "right");
  }

  function handle(context, at, color, follow) {
    if (!at) return;
    context.beginPath();
    context.arc(at[0], at[1], 6, 0, 2 * Math.PI);
    context.fillStyle = color;
    context.fill();
    context.lineWidth = 2;
    context.strokeStyle = "rgba(0,0,0,0.7)";
    context.stroke();
    handles.push({ at, follow });
  }

  /** Returns how far along a direction of the world a pointer moved, in world units. */
  function along(place, point, direction, from, to) {
    const here = place(point);
    const there = place(add(point, scaled(direction, view.data.diagonal * 1e-3)));
    if (!here || !there) return 0;
    const step = [(there[0] - here[0]) / (view.data.diagonal * 1e-3), (there[1] - here[1]) / (view.data.diagonal * 1e-3)];
    const square = step[0] ** 2 + step[1] ** 2;
    if (square < 1e-12) return 0;
    return ((to[0] - from[0]) * step[0] + (to[1] - from[1]) * step[1]) / square;
  }

  function drawClip(context, place) {
    const { box, planes } = view.clip;
    if (box) {
      const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((n) => place(cornerOf(box, n)));
      for (const [from, to] of EDGE_ENDS) line(context, corners[from], corners[to], "#ffd24a", 1.5);
      AXES.forEach(([, color], axis) => {
        [0, 1].forEach((side) => {
          const middle = middleOf(box);
          middle[axis] = box[side][axis];
          const direction = [0, 0, 0];
          direction[axis] = 1;
          handle(context, place(middle), color, (from, to) => {
            const moved = [[...box[0]], [...box[1]]];
            const value = box[side][axis] + along(place, middle, direction, from, to);
            const [low, high] = [view.data.bounds[0][axis], view.data.bounds[1][axis]];
            const room = (high - low) * 1e-3;
            moved[side][axis] = side
              ? Math.min(Math.max(value, box[0][axis] + room), high)
              : Math.max(Math.min(value, box[1][axis] - room), low);
            return { planes, box: moved };
          });
        });
      });
    }
    planes.forEach(([normal, offset], n) => {
      const direction = unit(normal);
      const distance = offset / length(normal);
      const middle = middleOf(view.data.bounds);
      const foot = add(middle, scaled(direction, distance - dot(middle, direction)));
      const outline = cut(view.data.bounds, direction, distance);
      outline.forEach((point, k) => {
        line(context, place(point), place(outline[(k + 1) % outline.length]), "#ffd24a", 1.5);
      });
      const tip = add(foot, scaled(direction, 0.15 * view.data.diagonal));
      line(context, place(foot), place(tip), "#ffd24a", 2);
      const changed = (plane) => ({ box, planes: planes.map((one, k) => (k === n ? plane : one)) });
      handle(context, place(foot), "#ffd24a", (from, to) =>
        changed([direction, distance + along(place, foot, direction, from, to)]),
      );
      handle(context, place(tip), "#fff", (from, to) => {
        const { right, up } = axesOf(view.camera);
        const scale = (place(tip) || [0, 0, 0, 1])[3];
        const by = add(scaled(right, (to[0] - from[0]) / scale), scaled(up, (from[1] - to[1]) / scale));
        const turned = unit(subtract(add(tip, by), foot));
        return changed([turned, dot(turned, foot)]);
      });
    });
  }

  /** Returns the corners of the polygon in which a plane cuts a box, in their order. */
  function cut(bounds, normal, offset) {
    const points = [];
    for (const [from, to] of EDGE_ENDS) {
      const [a, b] = [cornerOf(bounds, from), cornerOf(bounds, to)];
      const [p, q] = [dot(a, normal) - offset, dot(b, normal) - offset];
      if (p * q < 0) points.push(add(a, scaled(subtract(b, a), p / (p - q))));
    }
    if (points.length < 3) return [];
    const middle = scaled(points.reduce(add), 1 / points.length);
    const first = unit(subtract(points[0], middle));
    const second = cross(normal, first);
    const angle = (point) => Math.atan2(dot(subtract(point, middle), second), dot(subtract(point, middle), first));
    return points.sort((a, b) => angle(a) - angle(b));
  }

  function hit(point) {
    const found = handles.find(({ at }) => Math.hypot(at[0] - point[0], at[1] - point[1]) < REACH);
    if (!found) return null;
    // The handle stays the one that was pressed, whatever is drawn meanwhile.
    active = found;
    return {
      move: (to) => change(active.follow(point, to)),
      end: () => {
        active = null;
      },
    };
  }

  return { element, draw, paint, hit, near: (point) => handles.some(({ at }) => Math.hypot(at[0] - point[0], at[1] - point[1]) < REACH), handles: () => handles.map(({ at }) => at) };
}
