/** A term is explained on hover, focus and tap, for screen readers too; Escape closes it, and it is one tab stop. */
import { act, cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { closeExplanation, entryOf, figureEntry, search, symbolEntry } from "../service/glossary";
import { FAULTS, FIELDS, LIMITS, MODES } from "../wire/sample.gen";
import { Explained, Terms } from "./Explained";
import { Explanation } from "./Explanation";
import { SignalName } from "./values";

beforeEach(() => {
  vi.useFakeTimers();
});
afterEach(() => {
  act(() => closeExplanation());
  cleanup();
  vi.useRealTimers();
});

const tooltip = () => screen.queryByRole("tooltip");
const waits = (ms: number) => act(() => vi.advanceTimersByTime(ms));

function shown() {
  render(
    <>
      <button type="button">before</button>
      <Terms>
        <SignalName name="M_s" />
        <Explained of="fault:slack">slack</Explained>
        <SignalName name="S" />
      </Terms>
      <Explanation />
    </>,
  );
  return screen.getAllByRole("term");
}

test("hover shows meaning, equation and source after a delay, and leaving hides them", () => {
  const [M_s] = shown();
  fireEvent.pointerEnter(M_s as HTMLElement, { pointerType: "mouse" });
  waits(100);
  expect(tooltip()).toBeNull();
  waits(400);
  const { meaning, equation, source } = entryOf("quantity:M_s") ?? {};
  for (const part of [meaning, equation, source]) expect(tooltip()?.textContent).toContain(part);
  fireEvent.pointerLeave(M_s as HTMLElement);
  fireEvent.pointerEnter(tooltip() as HTMLElement); // a person may read the explanation with the pointer on it
  waits(1000);
  expect(tooltip()).not.toBeNull();
  fireEvent.pointerLeave(tooltip() as HTMLElement);
  waits(1000);
  expect(tooltip()).toBeNull();
});

test("a tap opens the explanation, a second one or a press elsewhere closes it", () => {
  const [, slack] = shown();
  fireEvent.pointerEnter(slack as HTMLElement, { pointerType: "touch" });
  waits(1000);
  expect(tooltip()).toBeNull();
  fireEvent.click(slack as HTMLElement);
  for (const [heading, text] of entryOf("fault:slack")?.more ?? []) {
    expect(tooltip()?.textContent).toContain(heading + text);
  }
  fireEvent.click(slack as HTMLElement);
  expect(tooltip()).toBeNull();
  fireEvent.click(slack as HTMLElement);
  fireEvent.pointerDown(screen.getByText("before"));
  expect(tooltip()).toBeNull();
});

test("the open explanation describes the term, and Escape closes nothing else", () => {
  const [M_s] = shown();
  const below = vi.fn();
  window.addEventListener("keydown", below);
  fireEvent.keyDown(M_s as HTMLElement, { key: "Enter" });
  expect(M_s?.getAttribute("aria-describedby")).toBe(tooltip()?.id);
  below.mockClear();
  fireEvent.keyDown(document.body, { key: "Escape" });
  expect(tooltip()).toBeNull();
  expect(below).not.toHaveBeenCalled();
  expect(M_s?.hasAttribute("aria-describedby")).toBe(false);
  fireEvent.keyDown(document.body, { key: "Escape" });
  expect(below).toHaveBeenCalledTimes(1);
  window.removeEventListener("keydown", below);
});

test("terms of a group are one tab stop, which the arrow keys move", () => {
  const words = shown();
  const stops = () => words.map((word) => word.tabIndex);
  expect(stops()).toEqual([0, -1, -1]);
  act(() => words[0]?.focus());
  fireEvent.keyDown(words[0] as HTMLElement, { key: "ArrowRight" });
  expect(document.activeElement).toBe(words[1]);
  expect(stops()).toEqual([-1, 0, -1]);
  fireEvent.keyDown(words[1] as HTMLElement, { key: "End" });
  expect(document.activeElement).toBe(words[2]);
  fireEvent.keyDown(words[2] as HTMLElement, { key: "ArrowRight" }); // after the last one nothing moves
  expect(document.activeElement).toBe(words[2]);
});

test("a term without an entry is plain text without a tab stop", () => {
  render(<Explained of="fault:of_tomorrow">unheard of</Explained>);
  expect(screen.queryByRole("term")).toBeNull();
  expect(screen.getByText("unheard of")).toBeDefined();
});

test("every name of the wire has an entry", () => {
  for (const { name } of FIELDS) expect(symbolEntry(name)?.kind, name).toBe("signal");
  for (const { symbol } of FIELDS) expect(symbolEntry(symbol), symbol).toBeDefined();
  for (const name of Object.keys(LIMITS)) expect(entryOf(`limit:${name}`), name).toBeDefined();
  for (const name of MODES) expect(entryOf(`mode:${name}`), name).toBeDefined();
  for (const name of FAULTS.filter((fault) => fault !== "none")) {
    expect(entryOf(`fault:${name}`), name).toBeDefined();
  }
});

test("symbols of compared recordings are those of the signals", () => {
  expect(symbolEntry("q′")).toBe(symbolEntry("q"));
  expect(symbolEntry("λ_q")?.name).toBe("lam_q");
});

test("a metric has the definition of its own result", () => {
  const old = { name: "rmse_q", label: "RMSE", unit: "rad", definition: "as it was once" };
  expect(figureEntry(old)).toMatchObject({ meaning: "as it was once", term: "RMSE" });
  expect(figureEntry(old).equation).toBe(entryOf("figure:rmse_q")?.equation);
});

test("the search combines symbol, word and unit", () => {
  expect(search("sensitivity peak").map(({ name }) => name)).toContain("M_s");
  expect(search("slack remedy").map(({ name }) => name)).toContain("slack");
  expect(search("no such word")).toEqual([]);
  expect(search("  ").length).toBeGreaterThan(200);
});
