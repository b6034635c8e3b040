import { cleanup, createEvent, fireEvent, render, screen } from "@testing-library/react";
import { useRef } from "react";
import { afterEach, expect, it, vi } from "vitest";
import { DRAGGED, useSignalDrop } from "./gestures";

afterEach(cleanup);

function Editor({ onDrop }: { onDrop: (name: string, title: string) => void }) {
  const editor = useRef<HTMLDivElement>(null);
  useSignalDrop(editor, onDrop);
  return <div ref={editor} />;
}

/** A panel from y = top on, 100 px high, as what takes the gestures lies over it. */
function place(title: string, top: number): HTMLElement {
  const panel = screen.getByLabelText(title);
  panel.getBoundingClientRect = () => new DOMRect(0, top, 400, 100);
  return panel;
}

function drag(kind: "dragOver" | "drop", clientY: number, types: readonly string[]): boolean {
  const target = screen.getByTestId("gestures");
  const event = createEvent[kind](target);
  const dataTransfer = { types, getData: () => "F_A", dropEffect: "none" };
  Object.defineProperties(event, {
    clientX: { value: 50 },
    clientY: { value: clientY },
    dataTransfer: { value: dataTransfer },
  });
  fireEvent(target, event);
  return event.defaultPrevented;
}

it("gives a dragged signal to the panel below the pointer, and leaves other drags alone", () => {
  const onDrop = vi.fn();
  render(
    <section aria-label="Charts">
      <figure data-panel={0} aria-label="Joint position" />
      <figure data-panel={1} aria-label="Tendon force" />
      <div data-testid="gestures" />
      <Editor onDrop={onDrop} />
    </section>,
  );
  place("Joint position", 0);
  const force = place("Tendon force", 100);
  expect(drag("dragOver", 150, ["text/plain"])).toBe(false);
  expect(drag("dragOver", 150, [DRAGGED])).toBe(true);
  expect(force.dataset.dropping).toBe("true");
  drag("drop", 150, [DRAGGED]);
  expect(onDrop.mock.calls).toEqual([["F_A", "Tendon force"]]);
  expect(force.dataset.dropping).toBeUndefined();
  expect(drag("dragOver", 350, [DRAGGED])).toBe(false);
  drag("drop", 350, [DRAGGED]);
  expect(onDrop).toHaveBeenCalledTimes(1);
});
