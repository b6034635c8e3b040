import { type RefObject, useCallback, useEffect, useRef, useState } from "react";

/** Translates mouse, touch and keyboard events on a stack of charts into actions. */

export interface GestureTarget {
  /** Wheel over the time axis; `at` is the position in the plotting area, 0 (left) to 1 (right). */
  zoomTime(factor: number, at: number): void;
  /** Wheel with V held; `clientY` of the pointer selects the chart. */
  zoomValues(factor: number, clientY: number): void;
  /** Drag by a fraction of the plotting area, positive to the right. */
  pan(by: number): void;
  reset(): void;
  /** Wheel without Ctrl over a chart: the page scrolls, and the chart does not zoom. */
  leftToScroll(): void;
  /** Position of the pointer; null outside the area. */
  hover(at: number | null): void;
  /** Index of a measuring cursor near `at`; null if there is none. */
  grab(at: number): number | null;
  move(cursor: number, at: number): void;
}

const ZOOM_PER_PIXEL = 0.0016;
const DRAG_STARTS_PX = 3;
const AXIS_KEYS: ReadonlySet<string> = new Set(["v", "b"]);

/** Listens on `area`, whose edges are those of the plotting area; returns a function that stops listening. */
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
    // Over a chart, V and B select the axis of the wheel; elsewhere letters navigate.
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

/** Handles a key on the focused chart; returns whether the key has an action. */
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

/** Whether the pointer's height is within the element. */
export function inside(element: HTMLElement, clientY: number): boolean {
  const box = element.getBoundingClientRect();
  return clientY >= box.top && clientY <= box.bottom;
}

/** Hint about zooming with the wheel, once per load of the page. */

const SHOWN_MS = 5000;

let isHintShown = false;

/** Whether the hint is visible, and the function that shows it. */
export function useWheelHint(): [boolean, () => void] {
  const [shown, show] = useState(false);
  const ask = useCallback(() => {
    if (isHintShown) return;
    isHintShown = true;
    show(true);
  }, []);
  useEffect(() => {
    if (!shown) return;
    const timer = window.setTimeout(() => show(false), SHOWN_MS);
    return () => window.clearTimeout(timer);
  }, [shown]);
  return [shown, ask];
}

/** Dragging the lower edge of a panel changes its height while a layout is edited. */

const PANELS = "figure[data-panel]";
/** Distance from the edge within which a press starts a drag [CSS px]. */
const REACH_PX = 5;

interface Edge {
  readonly title: string;
  readonly height: number;
  readonly bottom: number;
}

/**
 * Args:
 *   editor: element within the charts.
 *   onDrag: receives the panel's title and the ratio of its new height to that at the start of the drag, on each
 *     movement; `begins` is true for the first one.
 */
export function useHeightDrag(
  editor: RefObject<HTMLElement | null>,
  onDrag: (title: string, ratio: number, begins: boolean) => void,
): void {
  const newest = useRef(onDrag);
  newest.current = onDrag;
  useEffect(() => {
    const charts = editor.current?.closest("section[aria-label=Charts]");
    if (!(charts instanceof HTMLElement)) return;
    const abort = new AbortController();
    // Capture the events before the charts, which pan when they are dragged.
    const options = { capture: true, signal: abort.signal };
    let drag: { edge: Edge; pointer: number; moved: boolean } | null = null;

    function down(event: PointerEvent): void {
      const edge = event.button === 0 ? edgeAt(charts as HTMLElement, event) : null;
      if (edge === null) return;
      drag = { edge, pointer: event.pointerId, moved: false };
      event.preventDefault();
      event.stopPropagation();
    }

    function move(event: PointerEvent): void {
      if (drag === null || event.pointerId !== drag.pointer) {
        const near = event.buttons === 0 && edgeAt(charts as HTMLElement, event) !== null;
        (charts as HTMLElement).toggleAttribute("data-at-edge", near);
        return;
      }
      event.stopPropagation();
      const { edge, moved } = drag;
      const ratio = Math.max(0, edge.height + event.clientY - edge.bottom) / Math.max(1, edge.height);
      drag = { ...drag, moved: true };
      newest.current(edge.title, ratio, !moved);
    }

    function end(event: PointerEvent): void {
      if (event.pointerId === drag?.pointer) drag = null;
    }

    charts.addEventListener("pointerdown", down, options);
    document.addEventListener("pointermove", move, options);
    document.addEventListener("pointerup", end, options);
    document.addEventListener("pointercancel", end, options);
    return () => {
      abort.abort();
      charts.removeAttribute("data-at-edge");
    };
  }, [editor]);
}

function edgeAt(charts: HTMLElement, { clientX, clientY }: PointerEvent): Edge | null {
  for (const panel of charts.querySelectorAll<HTMLElement>(PANELS)) {
    const { left, right, bottom, height } = panel.getBoundingClientRect();
    const inside = clientX >= left && clientX <= right && Math.abs(clientY - bottom) <= REACH_PX;
    if (inside) return { title: panel.getAttribute("aria-label") ?? "", height, bottom };
  }
  return null;
}

/** Dropping a dragged signal adds it to a panel: in the charts, or in the rows of the editor. */

/** Data type of a dragged signal; other drags are ignored. */
export const DRAGGED = "application/x-sinew-signal";
const DROP_TARGETS = "figure[data-panel], li[data-panel-row]";

/** `editor`: element within the charts; `onDrop` receives the signal and the title of the panel. */
export function useSignalDrop(
  editor: RefObject<HTMLElement | null>,
  onDrop: (name: string, title: string) => void,
): void {
  const newest = useRef(onDrop);
  newest.current = onDrop;
  useEffect(() => {
    const charts = editor.current?.closest("section[aria-label=Charts]") ?? editor.current;
    if (!(charts instanceof HTMLElement)) return;
    let marked: Element | null = null;

    function mark(panel: Element | null): void {
      marked?.removeAttribute("data-dropping");
      panel?.setAttribute("data-dropping", "true");
      marked = panel;
    }

    function over(event: DragEvent): void {
      const panel = isSignal(event) ? panelAt(charts as HTMLElement, event) : null;
      mark(panel);
      if (panel === null) return;
      event.preventDefault();
      if (event.dataTransfer) event.dataTransfer.dropEffect = "copy";
    }

    function drop(event: DragEvent): void {
      const title = marked?.getAttribute("aria-label") ?? null;
      mark(null);
      if (!isSignal(event) || title === null) return;
      event.preventDefault();
      newest.current(event.dataTransfer?.getData(DRAGGED) ?? "", title);
    }

    const unmark = () => mark(null);
    charts.addEventListener("dragover", over);
    charts.addEventListener("drop", drop);
    document.addEventListener("dragend", unmark);
    return () => {
      unmark();
      charts.removeEventListener("dragover", over);
      charts.removeEventListener("drop", drop);
      document.removeEventListener("dragend", unmark);
    };
  }, [editor]);
}

function isSignal(event: DragEvent): boolean {
  return event.dataTransfer?.types.includes(DRAGGED) ?? false;
}

/** Finds the panel by position, because the area that receives gestures covers the panels. */
function panelAt(charts: HTMLElement, { clientX, clientY }: DragEvent): Element | null {
  const holds = (one: Element) => {
    const { left, right, top, bottom } = one.getBoundingClientRect();
    return clientX >= left && clientX <= right && clientY >= top && clientY <= bottom;
  };
  return [...charts.querySelectorAll(DROP_TARGETS)].find(holds) ?? null;
}
