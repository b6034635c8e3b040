/** An input explains itself to pointer and keyboard, with its bounds; typing closes the explanation. */
import { MantineProvider } from "@mantine/core";
import { act, cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { closeExplanation, entryOf, fieldEntry, settingEntry } from "../service/glossary";
import type { Setting } from "../wire/types";
import { Explanation } from "./Explanation";
import { ValueBox } from "./ValueBox";

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(() => {
  act(() => closeExplanation());
  cleanup();
  vi.useRealTimers();
});

const tooltip = () => screen.queryByRole("tooltip");

function box() {
  render(
    <MantineProvider>
      <ValueBox
        label="Wall stiffness [N/m]"
        unit="N/m"
        value={20000}
        decimals={0}
        step={1000}
        width={104}
        messageId="nowhere"
        entry={fieldEntry("wall.k_wall", "deg", { minimum: 100, maximum: 40000 })}
        onCommit={() => undefined}
        onProblem={() => undefined}
      />
      <Explanation />
    </MantineProvider>,
  );
  return screen.getByRole("textbox");
}

test("hover shows the meaning and the bounds of a box, and leaving hides them", () => {
  const input = box();
  fireEvent.pointerEnter(input, { pointerType: "mouse" });
  act(() => vi.advanceTimersByTime(500));
  expect(tooltip()?.textContent).toContain(entryOf("setting:wall.k_wall")?.meaning);
  expect(tooltip()?.textContent).toContain("100 to 40000 N/m");
  fireEvent.pointerLeave(input);
  act(() => vi.advanceTimersByTime(500));
  expect(tooltip()).toBeNull();
});

test("focus shows them too, typing hides them, and one Escape discards the typed text", () => {
  const input = box() as HTMLInputElement;
  act(() => input.focus());
  expect(tooltip()?.id).toBe(input.getAttribute("aria-describedby"));
  fireEvent.input(input, { target: { value: "5" } });
  expect(tooltip()).toBeNull();
  expect(input.value).toBe("5");
  fireEvent.keyDown(input, { key: "Escape" });
  expect(input.value).toBe("20000");
  act(() => input.blur());
  act(() => input.focus());
  expect(tooltip()).not.toBeNull();
  fireEvent.keyDown(input, { key: "ArrowUp" });
  expect(input.value).toBe("21000");
  fireEvent.keyDown(input, { key: "Escape" });
  expect([tooltip(), input.value]).toEqual([null, "20000"]);
});

test("bounds are in the person's unit, and an unknown field has no entry", () => {
  const q = { minimum: -Math.PI / 2, maximum: Math.PI / 2 };
  expect(fieldEntry("wall.q_wall", "deg", q)?.more).toEqual([["Accepted", "−90 to 90°"]]);
  expect(fieldEntry("wall.nothing", "deg", q)).toBeUndefined();
  const chip: Setting = {
    name: "chip_s",
    symbol: "t_c",
    meaning: "shortest time between two changes",
    unit: "s",
    default: 0.08,
    minimum: 0.001,
    maximum: 2,
  };
  expect(settingEntry(chip, "deg")).toMatchObject({
    term: "t_c",
    meaning: "Shortest time between two changes",
    unit: "s",
    more: [
      ["Accepted", "0.001 to 2 s"],
      ["Default", "0.08 s"],
    ],
  });
});
