import { cleanup, createEvent, fireEvent, render, screen } from "@testing-library/react";
import { useRef } from "react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { DRAGGED, listen, useHeightDrag, useSignalDrop } from "./gestures";

describe("gestures", () => {
  const target = {
    zoomTime: vi.fn(),
    zoomValues: vi.fn(),
    pan: vi.fn(),
    reset: vi.fn(),
    leftToScroll: vi.fn(),
    hover: vi.fn(),
    grab: vi.fn(() => null),
    move: vi.fn(),
  };
  let area: HTMLElement;
  let stop: () => void;

  beforeEach(() => {
    vi.clearAllMocks();
    area = document.createElement("div");
    area.setPointerCapture = vi.fn();
    document.body.append(area);
    stop = listen(area, target);
  });

  afterEach(() => {
    stop();
    area.remove();
  });

  /** Turns the wheel; returns true if the page may scroll. */
  function turn(how: WheelEventInit = {}): boolean {
    return area.dispatchEvent(
      new WheelEvent("wheel", { deltaY: 100, bubbles: true, cancelable: true, ...how }),
    );
  }

  const pointer = (kind: string) => area.dispatchEvent(new PointerEvent(kind, { button: 0, pointerId: 1 }));

  it("does not handle the wheel without a key, and reports it", () => {
    expect(turn()).toBe(true);
    expect(target.zoomTime).not.toHaveBeenCalled();
    expect(target.leftToScroll).toHaveBeenCalledTimes(1);
  });

  it("zooms with Ctrl or Cmd, and prevents the page from zooming", () => {
    for (const how of [{ ctrlKey: true }, { metaKey: true }]) expect(turn(how)).toBe(false);
    expect(target.zoomTime).toHaveBeenCalledTimes(2);
    expect(target.leftToScroll).not.toHaveBeenCalled();
  });

  it("does not handle the wheel after a click either", () => {
    pointer("pointerdown");
    pointer("pointerup");
    expect(turn()).toBe(true);
    expect(target.zoomTime).not.toHaveBeenCalled();
  });

  it("zooms values while V is held", () => {
    window.dispatchEvent(new KeyboardEvent("keydown", { key: "v" }));
    expect(turn()).toBe(false);
    expect(target.zoomValues).toHaveBeenCalledTimes(1);
    window.dispatchEvent(new KeyboardEvent("keyup", { key: "v" }));
    expect(turn()).toBe(true);
  });
});

describe("signal drop", () => {
  afterEach(cleanup);

  function Editor({ onDrop }: { onDrop: (name: string, title: string) => void }) {
    const editor = useRef<HTMLDivElement>(null);
    useSignalDrop(editor, onDrop);
    return <div ref={editor} />;
  }

  /** A panel from y = top on, 100 px high, below the area that receives the gestures. */
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

  it("adds a dragged signal to the panel below the pointer, and ignores other drags", () => {
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
});

describe("useHeightDrag", () => {
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

  it("drags the lower edge of a panel, and does not handle a press elsewhere", () => {
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
});
