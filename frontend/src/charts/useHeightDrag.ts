/** While a layout is edited, the lower edge of a panel in the charts is dragged to change the panel's height. */

import { type RefObject, useEffect, useRef } from "react";

const PANELS = "figure[data-panel]";
/** How near to the edge a press begins a drag [CSS px]. */
const REACH_PX = 5;

interface Edge {
  readonly title: string;
  readonly height: number;
  readonly bottom: number;
}

/**
 * Args:
 *   editor: lies within the charts.
 *   onDrag: gets the title of the panel and its wanted height over its height at the begin of the drag; called at each
 *     movement, the first one with `begins`.
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
    // before the charts, which pan when they are dragged
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
