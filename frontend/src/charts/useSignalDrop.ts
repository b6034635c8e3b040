/** A dragged signal is dropped onto a panel: in the charts themselves, or in the rows of their editor. */

import { type RefObject, useEffect, useRef } from "react";

/** What a dragged signal is told by; other things that are dragged are left alone. */
export const DRAGGED = "application/x-sinew-signal";
const PANELS = "figure[data-panel], li[data-panel-row]";

/** `editor` lies within the charts; `onDrop` gets the signal and the title of the panel. */
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

    const leave = () => mark(null);
    charts.addEventListener("dragover", over);
    charts.addEventListener("drop", drop);
    document.addEventListener("dragend", leave);
    return () => {
      leave();
      charts.removeEventListener("dragover", over);
      charts.removeEventListener("drop", drop);
      document.removeEventListener("dragend", leave);
    };
  }, [editor]);
}

function isSignal(event: DragEvent): boolean {
  return event.dataTransfer?.types.includes(DRAGGED) ?? false;
}

/** By place: what takes the gestures lies over the panels. */
function panelAt(charts: HTMLElement, { clientX, clientY }: DragEvent): Element | null {
  const holds = (one: Element) => {
    const { left, right, top, bottom } = one.getBoundingClientRect();
    return clientX >= left && clientX <= right && clientY >= top && clientY <= bottom;
  };
  return [...charts.querySelectorAll(PANELS)].find(holds) ?? null;
}
