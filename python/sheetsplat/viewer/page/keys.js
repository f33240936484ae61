// Keys, which work wherever the focus is: they belong to the page, and only what has its own use for one keeps it.

const TURN = Math.PI / 24;
const NUMBER_KEYS = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"];

/** Lists what keys and gestures do, for people. */
const keyTable = (modes) => [
  ["Drag, one finger, arrow keys", "turn"],
  ["Right or middle drag, Shift and drag, two fingers, Shift and arrows", "move"],
  ["Wheel, two fingers, + and −", "enlarge"],
  ["Ctrl and drag, twist of two fingers, Q and E", "roll"],
  ["Double-click, Enter", "turn about what is there, what is in the middle"],
  ["R", "first view"],
  ["X, Y, Z; with Shift from the other side", "look along an axis"],
  ["P", "perspective or parallel projection"],
  [`1 … ${modes}`, "mode"],
  ["B", "box with scales"],
  ["D, A", "measure a distance, an angle; Escape ends it"],
  ["S; with Shift", "save the picture as it is shown; alone"],
  ["Space", "play"],
  ["Ctrl+Z; Ctrl+Shift+Z, Ctrl+Y", "undo; redo"],
];

/** Whether an element has its own use for a key. */
function keepsKey(element, event) {
  if (!(element instanceof Element)) return false;
  if (element.matches("input[type=range]")) return NUMBER_KEYS.includes(event.key);
  if (element.matches("input:not([type=checkbox], [type=color]), select, textarea, [contenteditable]")) return true;
  return element.matches("button, summary, a, input") && [" ", "Enter"].includes(event.key);
}

/** Listens to the keys of a target until the function that it returns is called; `act` says what they do. */
function listenToKeys(target, root, act) {
  function pressed(event) {
    if (event.defaultPrevented || keepsKey(event.target, event) || root.querySelector("dialog[open]")) return;
    const key = event.key.toLowerCase();
    if ((event.ctrlKey || event.metaKey) && !event.altKey) {
      if (key === "z") act.undo(event.shiftKey);
      else if (key === "y") act.undo(true);
      else return;
    } else if (event.altKey || event.ctrlKey || event.metaKey || !act.camera()) return;
    else if (event.key in ARROWS) {
      const [across, upwards] = ARROWS[event.key];
      const camera = act.camera();
      act.setCamera(event.shiftKey ? panned(camera, across * 0.05, upwards * 0.05) : orbited(camera, across * TURN, upwards * TURN));
    } else if (key === "+" || key === "=") act.setCamera(zoomed(act.camera(), 1.15));
    else if (key === "-" || key === "_") act.setCamera(zoomed(act.camera(), 1 / 1.15));
    else if (key === "q" || key === "e") act.setCamera(rolled(act.camera(), key === "q" ? TURN : -TURN));
    else if ("xyz".includes(key)) act.lookFrom([0, 1, 2].map((n) => (n === "xyz".indexOf(key) ? (event.shiftKey ? 1 : -1) : 0)));
    else if (/^[1-9]$/.test(key)) act.mode(Number(key) - 1);
    else if (key in act.keys) act.keys[key](event.shiftKey);
    else return;
    event.preventDefault();
  }
  target.addEventListener("keydown", pressed);
  return () => target.removeEventListener("keydown", pressed);
}
