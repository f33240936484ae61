// Cameras as the session knows them: {kind, eye, target, up, height or fov_y and shift}; `up` is at right angles to the view.
// No function changes what it is given.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const scaled = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = (a) => Math.hypot(a[0], a[1], a[2]);
const unit = (a) => scaled(a, 1 / (length(a) || 1));
const radians = (degrees) => (degrees * Math.PI) / 180;

/** Rotates a vector about a unit axis, counter-clockwise seen against the axis. */
function rotated(vector, axis, angle) {
  const c = Math.cos(angle);
  const s = Math.sin(angle);
  return add(add(scaled(vector, c), scaled(cross(axis, vector), s)), scaled(axis, dot(axis, vector) * (1 - c)));
}

/** Returns the directions to the right, upwards and back to the viewer, and the distance of eye and target. */
function axesOf(camera) {
  const away = subtract(camera.eye, camera.target);
  const back = unit(away);
  const right = unit(cross(camera.up, back));
  return { right, up: cross(back, right), back, distance: length(away) };
}

/** Returns how far the middle of the picture lies to the right of the target and above it, in heights of the picture. */
const shiftOf = (camera) => camera.shift ?? [0, 0];

/** World units from the bottom of the picture to the top, in the plane through the target. */
function worldHeight(camera) {
  if (camera.kind === "orthographic") return camera.height;
  return 2 * axesOf(camera).distance * Math.tan(radians(camera.fov_y) / 2);
}

/** Turns the eye around the target: right by `turn` and up by `rise`, radians. */
function orbited(camera, turn, rise) {
  const { right, up, back, distance } = axesOf(camera);
  const turnedBack = rotated(rotated(back, up, turn), right, -rise);
  const turnedUp = rotated(up, right, -rise);
  return { ...camera, eye: add(camera.target, scaled(turnedBack, distance)), up: turnedUp };
}

/** Turns the picture about its middle, counter-clockwise, radians. */
function rolled(camera, angle) {
  return { ...camera, up: rotated(axesOf(camera).up, axesOf(camera).back, -angle) };
}

/** Moves what is seen by shares of the picture's height, to the right and upwards. */
function panned(camera, across, upwards) {
  const { right, up } = axesOf(camera);
  const height = worldHeight(camera);
  const by = add(scaled(right, -across * height), scaled(up, -upwards * height));
  return { ...camera, eye: add(camera.eye, by), target: add(camera.target, by) };
}

/** Enlarges by a factor, about a point of the picture given in shares of its height from its middle. */
function zoomed(camera, factor, across = 0, upwards = 0) {
  const [x, y] = shiftOf(camera);
  const kept = panned(camera, -(across + x) * (1 - 1 / factor), -(upwards + y) * (1 - 1 / factor));
  if (camera.kind === "orthographic") return { ...kept, height: camera.height / factor };
  const { back, distance } = axesOf(kept);
  return { ...kept, eye: add(kept.target, scaled(back, distance / factor)) };
}

/** Returns the camera of the other kind that shows the target as large. */
function projectedAs(camera, kind) {
  if (camera.kind === kind) return camera;
  const { eye, target, up } = camera;
  if (kind === "orthographic") return { kind, eye, target, up, height: worldHeight(camera) };
  const fovY = 30;
  const distance = camera.height / (2 * Math.tan(radians(fovY) / 2));
  return { kind, eye: add(target, scaled(axesOf(camera).back, distance)), target, up, fov_y: fovY };
}

/** Returns a camera between two of one kind: share 0 is the first one. */
function between(first, second, share) {
  const a = axesOf(first);
  const b = axesOf(second);
  const mix = (x, y) => x + (y - x) * share;
  const turned = (from, to) => {
    const found = from.map((part, n) => mix(part, to[n]));
    return length(found) > 1e-6 ? unit(found) : unit(add(found, a.right));
  };
  const back = turned(a.back, b.back);
  const target = first.target.map((part, n) => mix(part, second.target[n]));
  const grown = (x, y) => Math.exp(mix(Math.log(x), Math.log(y)));
  const right = unit(cross(turned(a.up, b.up), back));
  const camera = { ...second, target, eye: add(target, scaled(back, grown(a.distance, b.distance))) };
  camera.up = cross(back, right);
  if (second.kind === "orthographic") camera.height = grown(first.height, second.height);
  return camera;
}

/** Returns where a world point is in a picture of a size in pixels, and its depth; null behind the eye. */
function placeOf(camera, size, point) {
  const { right, up, back, distance } = axesOf(camera);
  const from = subtract(point, camera.target);
  const depth = distance - dot(from, back);
  let scale = size[1] / worldHeight(camera);
  if (camera.kind === "perspective") {
    if (depth <= 1e-3 * distance) return null;
    scale *= distance / depth;
  }
  const [x, y] = shiftOf(camera);
  const middle = [size[0] / 2 - x * size[1], size[1] / 2 + y * size[1]];
  return [middle[0] + dot(from, right) * scale, middle[1] - dot(from, up) * scale, depth, scale];
}
