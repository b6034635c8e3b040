import { cleanup, createEvent, fireEvent, render, screen } from "@testing-library/react";
import { useRef } from "react";
import { afterEach, expect, it, vi } from "vitest";
import { useHeightDrag } from "./gestures";

afterEach(cleanup);

function Editor({ onDrag }: { onDrag: (title: string, ratio: number, begins: boolean) => void }) {
  const editor = useRef<HTMLDivElement>(null);
  useHeightDrag(editor, onDrag);
  return <div ref={editor} />;
}

function pointer(kind: "pointerDown" | "pointerMove" | "pointerUp", clientY: number, buttons: number) {
  const target = screen.getByTestId("gestures");
  const event = createEvent[kind](target);
  Object.defineProperties(event, {
    clientX: { value: 50 },
    clientY: { value: clientY },
    button: { value: 0 },
    buttons: { value: buttons },
    pointerId: { value: 7 },
  });
  fireEvent(target, event);
}

it("drags the lower edge of a panel and leaves a press elsewhere to the charts", () => {
  const onDrag = vi.fn();
  const onPan = vi.fn();
  render(
    <section aria-label="Charts">
      <figure data-panel={0} aria-label="Joint position" />
      <figure data-panel={1} aria-label="Tendon force" />
      <div data-testid="gestures" onPointerDown={onPan} />
      <Editor onDrag={onDrag} />
    </section>,
  );
  for (const [title, top] of [
    ["Joint position", 0],
    ["Tendon force", 100],
  ] as const)
    screen.getByLabelText(title).getBoundingClientRect = () => new DOMRect(0, top, 400, 100);

  pointer("pointerDown", 50, 1);
  pointer("pointerMove", 80, 1);
  pointer("pointerUp", 80, 0);
  expect(onPan).toHaveBeenCalledTimes(1);
  expect(onDrag).not.toHaveBeenCalled();

  pointer("pointerMove", 198, 0);
  expect(screen.getByLabelText("Charts").hasAttribute("data-at-edge")).toBe(true);
  pointer("pointerDown", 198, 1);
  pointer("pointerMove", 250, 1);
  pointer("pointerMove", 150, 1);
  pointer("pointerUp", 150, 0);
  pointer("pointerMove", 120, 0);
  expect(onPan).toHaveBeenCalledTimes(1);
  expect(onDrag.mock.calls).toEqual([
    ["Tendon force", 1.5, true],
    ["Tendon force", 0.5, false],
  ]);
});
