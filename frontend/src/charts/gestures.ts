/** Mouse, touch and keyboard on a stack of charts, told as intentions. */

export interface GestureTarget {
  /** Wheel over the time axis; `at` is the place in the plotting area, 0 left to 1 right. */
  zoomTime(factor: number, at: number): void;
  /** Wheel with V held; the pointer's height on the page tells the chart. */
  zoomValues(factor: number, clientY: number): void;
  /** Drag by a fraction of the plotting area, positive to the right. */
  pan(by: number): void;
  reset(): void;
  /** The wheel turned without Ctrl over a chart: the page scrolls, nothing zooms. */
  leftToScroll(): void;
  /** Follow the pointer, or null when it has left. */
  hover(at: number | null): void;
  /** Take hold of a measuring cursor near `at`, if there is one. */
  grab(at: number): number | null;
  move(cursor: number, at: number): void;
}

const ZOOM_PER_PIXEL = 0.0016;
const DRAG_STARTS_PX = 3;
const AXIS_KEYS: ReadonlySet<string> = new Set(["v", "b"]);

/** Listen on `area`, whose edges are those of the plotting area; returns how to stop. */
export function listen(area: HTMLElement, target: GestureTarget): () => void {
  const abort = new AbortController();
  const held = new Set<string>();
  let over = false;
  let drag: { pointer: number; x: number; cursor: number | null; moved: boolean } | null = null;

  const fraction = (clientX: number) => {
    const box = area.getBoundingClientRect();
    return (clientX - box.left) / Math.max(1, box.width);
  };

  function onWheel(event: WheelEvent): void {
    const meant = event.ctrlKey || event.metaKey || held.has("v") || held.has("b");
    if (!meant) {
      target.leftToScroll();
      return;
    }
    event.preventDefault();
    const factor = Math.exp(event.deltaY * (event.deltaMode === 0 ? 1 : 16) * ZOOM_PER_PIXEL);
    const both = held.has("b");
    if (!held.has("v") || both) target.zoomTime(factor, fraction(event.clientX));
    if (held.has("v") || both) target.zoomValues(factor, event.clientY);
  }

  function onDown(event: PointerEvent): void {
    if (event.button !== 0) return;
    area.setPointerCapture(event.pointerId);
    drag = {
      pointer: event.pointerId,
      x: event.clientX,
      cursor: target.grab(fraction(event.clientX)),
      moved: false,
    };
  }

  function onMove(event: PointerEvent): void {
    target.hover(fraction(event.clientX));
    if (drag === null || event.pointerId !== drag.pointer) return;
    if (drag.cursor !== null) {
      target.move(drag.cursor, fraction(event.clientX));
      return;
    }
    const shift = event.clientX - drag.x;
    if (!drag.moved && Math.abs(shift) < DRAG_STARTS_PX) return;
    target.pan(shift / Math.max(1, area.getBoundingClientRect().width));
    drag = { ...drag, x: event.clientX, moved: true };
  }

  function onUp(event: PointerEvent): void {
    if (drag?.pointer === event.pointerId) drag = null;
  }

  function onKey(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const key = event.key.toLowerCase();
    // over a chart V and B choose the axis of the wheel; elsewhere letters navigate
    if (over && AXIS_KEYS.has(key) && !isTyping(event.target)) event.stopPropagation();
    if (event.type === "keydown") held.add(key);
    else held.delete(key);
  }

  const options = { signal: abort.signal };
  area.addEventListener("wheel", onWheel, { ...options, passive: false });
  area.addEventListener("pointerdown", onDown, options);
  area.addEventListener("pointermove", onMove, options);
  area.addEventListener("pointerup", onUp, options);
  area.addEventListener("pointercancel", onUp, options);
  area.addEventListener(
    "pointerenter",
    () => {
      over = true;
    },
    options,
  );
  area.addEventListener(
    "pointerleave",
    () => {
      over = false;
      target.hover(null);
    },
    options,
  );
  area.addEventListener("dblclick", () => target.reset(), options);
  window.addEventListener("keydown", onKey, { ...options, capture: true });
  window.addEventListener("keyup", onKey, { ...options, capture: true });
  window.addEventListener("blur", () => held.clear(), options);
  return () => abort.abort();
}

function isTyping(target: EventTarget | null): boolean {
  return target instanceof HTMLElement && target.matches("input, textarea, select, [contenteditable]");
}

/** What the arrow keys do on a chart that has the focus; true when the key was used. */
export function steer(key: string, target: GestureTarget): boolean {
  const actions: Record<string, () => void> = {
    ArrowLeft: () => target.pan(0.1),
    ArrowRight: () => target.pan(-0.1),
    ArrowUp: () => target.zoomTime(0.8, 0.5),
    ArrowDown: () => target.zoomTime(1.25, 0.5),
    Home: () => target.reset(),
  };
  const action = actions[key];
  action?.();
  return action !== undefined;
}

/** Whether a pointer at this height is over the element. */
export function inside(element: HTMLElement, clientY: number): boolean {
  const box = element.getBoundingClientRect();
  return clientY >= box.top && clientY <= box.bottom;
}
