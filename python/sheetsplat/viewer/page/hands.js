// What pointers do in the picture: drags, wheels, two fingers, clicks, and where a pointer rests.

// A press that moved fewer pixels is a click.
const STILL = 4;

/**
 * Listens to the pointers of the picture. `act`: camera(), setCamera(camera), began() before a press does anything,
 * hit(point) for a handle there, near(point) whether there is one, aims() whether clicks measure, pick(share, purpose),
 * rests(point) and leaves() for a pointer without a press. Returns {moving, pointer}: whether something is dragged, and
 * where a pointer rests, in shares of the picture, or null.
 */
function listenToHands(stage, act) {
  const fingers = new Map();
  const hands = { moving: false, pointer: null };
  const pointOf = (event) => {
    const box = stage.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const shareOf = ([x, y]) => ({ x: x / stage.clientWidth, y: y / stage.clientHeight });
  let grip = null;
  let pressed = null; // Where a click began, while it may be one.
  let pointed = 0;
  function pointAt(point) {
    const { x, y } = shareOf(point);
    hands.pointer = [x, y];
    stage.style.cursor = act.near(point) ? "grab" : "";
    act.rests(point);
    clearTimeout(pointed);
    pointed = setTimeout(hands.ask, 60);
  }
  /** Asks what is under the pointer; the session answers when the picture is complete. */
  hands.ask = () => {
    if (hands.pointer && !hands.moving) act.pick({ x: hands.pointer[0], y: hands.pointer[1] }, "tell");
  };
  /** Picks what is at a point, the middle of the picture unless given. */
  hands.pick = (purpose, point = [stage.clientWidth / 2, stage.clientHeight / 2]) => act.pick(shareOf(point), purpose);

  stage.addEventListener("contextmenu", (event) => event.preventDefault());
  stage.addEventListener("pointerdown", (event) => {
    if (!act.camera() || event.target.closest(".notices")) return;
    stage.focus({ preventScroll: true });
    stage.setPointerCapture(event.pointerId);
    const point = pointOf(event);
    fingers.set(event.pointerId, point);
    hands.moving = true;
    act.began();
    grip = fingers.size === 1 && event.button === 0 ? act.hit(point) : null;
    pressed = fingers.size === 1 && event.button === 0 && !grip ? point : null;
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
    if (pressed && act.aims() && Math.hypot(point[0] - pressed[0], point[1] - pressed[1]) < STILL) return;
    pressed = null;
    const camera = act.camera();
    const [dx, dy] = [point[0] - before[0], point[1] - before[1]];
    const high = stage.clientHeight;
    if (fingers.size === 1) {
      if (event.buttons & 6 || event.shiftKey) act.setCamera(panned(camera, dx / high, -dy / high));
      else if (event.ctrlKey || event.metaKey) {
        const middle = [stage.clientWidth / 2, high / 2];
        const angle = (at) => Math.atan2(middle[1] - at[1], at[0] - middle[0]);
        act.setCamera(rolled(camera, angle(point) - angle(before)));
      } else act.setCamera(orbited(camera, (-dx / high) * Math.PI, (dy / high) * Math.PI));
    } else if (fingers.size === 2) {
      const other = [...fingers].find(([id]) => id !== event.pointerId)[1];
      const spread = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]) || 1;
      const angle = (at) => Math.atan2(other[1] - at[1], at[0] - other[0]);
      let next = panned(camera, dx / 2 / high, -dy / 2 / high);
      const middle = [(point[0] + other[0]) / 2, (point[1] + other[1]) / 2];
      next = zoomed(next, spread(point) / spread(before), (middle[0] - stage.clientWidth / 2) / high, (high / 2 - middle[1]) / high);
      act.setCamera(rolled(next, angle(point) - angle(before)));
    }
    fingers.set(event.pointerId, point);
  });
  const released = (event) => {
    fingers.delete(event.pointerId);
    if (fingers.size) return;
    if (grip) grip.end();
    grip = null;
    hands.moving = false;
    if (pressed && act.aims()) hands.pick("measure", pressed);
    pressed = null;
    pointAt(pointOf(event));
  };
  stage.addEventListener("pointerup", released);
  stage.addEventListener("pointercancel", released);
  stage.addEventListener("pointerleave", () => {
    act.leaves();
    hands.pointer = null;
  });
  stage.addEventListener("wheel", (event) => {
    if (!act.camera()) return;
    event.preventDefault();
    const [x, y] = pointOf(event);
    const high = stage.clientHeight;
    const lines = event.deltaMode === 1 ? 33 : event.deltaMode === 2 ? high : 1;
    const by = Math.min(Math.max(-event.deltaY * lines, -240), 240);
    act.setCamera(zoomed(act.camera(), Math.exp(by * 0.0016), (x - stage.clientWidth / 2) / high, (high / 2 - y) / high));
  }, { passive: false });
  stage.addEventListener("dblclick", (event) => {
    if (!act.aims()) hands.pick("centre", pointOf(event));
  });
  return hands;
}
