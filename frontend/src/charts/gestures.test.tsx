import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { listen } from "./gestures";

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
let leave: () => void;

beforeEach(() => {
  vi.clearAllMocks();
  area = document.createElement("div");
  area.setPointerCapture = vi.fn();
  document.body.append(area);
  leave = listen(area, target);
});

afterEach(() => {
  leave();
  area.remove();
});

/** Turn the wheel; true where the page may scroll by it. */
function turn(how: WheelEventInit = {}): boolean {
  return area.dispatchEvent(
    new WheelEvent("wheel", { deltaY: 100, bubbles: true, cancelable: true, ...how }),
  );
}

const pointer = (kind: string) => area.dispatchEvent(new PointerEvent(kind, { button: 0, pointerId: 1 }));

it("leaves the wheel to the page, and says so", () => {
  expect(turn()).toBe(true);
  expect(target.zoomTime).not.toHaveBeenCalled();
  expect(target.leftToScroll).toHaveBeenCalledTimes(1);
});

it("zooms with Ctrl or Cmd, and the page does not", () => {
  for (const how of [{ ctrlKey: true }, { metaKey: true }]) expect(turn(how)).toBe(false);
  expect(target.zoomTime).toHaveBeenCalledTimes(2);
  expect(target.leftToScroll).not.toHaveBeenCalled();
});

it("leaves the wheel to the page after a click as before it", () => {
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
