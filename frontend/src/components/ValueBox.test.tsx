import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { useState } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { fillText } from "../samples/texts";
import { NumberField } from "./fields";
import { TEXTS } from "./texts";
import { ValueBox } from "./ValueBox";

const NOT_NUMBERS = ["5-3", "1e", "0,5,1", "12°", "--4"];

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(cleanup);

const box = () => screen.getByRole("textbox") as HTMLInputElement;
const type = (text: string) => fireEvent.change(box(), { target: { value: text } });
const press = (key: string) => fireEvent.keyDown(box(), { key });

function openBox({ isInForm = false } = {}) {
  const sent = vi.fn();
  const onProblem = vi.fn();
  const props = {
    label: "q_ref",
    unit: "°",
    value: 12,
    decimals: 1,
    step: 1,
    width: 100,
    messageId: "why",
    isInForm,
  };
  render(<ValueBox {...props} onCommit={sent} onProblem={onProblem} />, { wrapper: MantineProvider });
  return { sent, onProblem };
}

it.each(NOT_NUMBERS)("sends nothing for %j, shows the error, and Escape restores", (text) => {
  const { sent, onProblem } = openBox();
  type(text);
  press("Enter");
  expect(sent).not.toHaveBeenCalled();
  expect(box().value).toBe(text);
  expect(box().getAttribute("aria-invalid")).toBe("true");
  expect(onProblem).toHaveBeenLastCalledWith(
    fillText(TEXTS.oddNotSent, { problem: `“${text}” is not a number` }),
  );
  press("Escape");
  expect(box().value).toBe("12.0");
  expect(onProblem).toHaveBeenLastCalledWith(null);
  fireEvent.blur(box());
  expect(sent).not.toHaveBeenCalled();
});

it.each([
  ["1e1", 10],
  ["−53", -53],
  ["7.26", 7.3],
  ["-0.01", 0],
  ["0,5", 0.5],
])("sends %j as a number with the decimals of the box", (text, value) => {
  const { sent } = openBox();
  type(text);
  press("Enter");
  fireEvent.blur(box());
  expect(sent.mock.calls).toEqual([[value]]);
});

it.each(["blur", "Escape"])(
  "does not send a typed value on %s, restores the previous one, and reports it",
  (how) => {
    vi.useFakeTimers();
    const { sent, onProblem } = openBox();
    type("25,04");
    expect(box().dataset.unsent).toBe("true");
    expect(onProblem).toHaveBeenLastCalledWith(fillText(TEXTS.unsent, { value: "25.0°" }));
    if (how === "blur") fireEvent.blur(box());
    else press("Escape");
    expect(sent).not.toHaveBeenCalled();
    expect(box().value).toBe("12.0");
    expect(box().dataset.unsent).toBeUndefined();
    if (how === "blur")
      expect(onProblem).toHaveBeenLastCalledWith(fillText(TEXTS.wasNotSent, { value: "25.0°" }));
    vi.advanceTimersByTime(10_000);
    expect(onProblem).toHaveBeenLastCalledWith(null);
    vi.useRealTimers();
  },
);

it("retains its value in a form, for the button that sends it", () => {
  const { sent } = openBox({ isInForm: true });
  type("25");
  expect(box().dataset.unsent).toBeUndefined();
  fireEvent.blur(box());
  expect(sent.mock.calls).toEqual([[25]]);
});

it("sends nothing when it is left unchanged or empty", () => {
  const { sent } = openBox();
  fireEvent.blur(box());
  press("Enter");
  type("");
  press("Enter");
  expect(sent).not.toHaveBeenCalled();
  expect(box().value).toBe("12.0");
});

it("steps with the arrow keys, and sends only on Enter", () => {
  const { sent } = openBox();
  press("ArrowUp");
  press("ArrowUp");
  press("ArrowDown");
  expect(box().value).toBe("13.0");
  expect(sent).not.toHaveBeenCalled();
  press("Enter");
  expect(sent.mock.calls).toEqual([[13]]);
});

function openField(seen: (value: number | string) => void) {
  function Form() {
    const [value, setValue] = useState<number | string>(0.5);
    seen(value);
    return <NumberField label="λ_q" value={value} onChange={setValue} />;
  }
  render(<Form />, { wrapper: MantineProvider });
}

it.each([...NOT_NUMBERS, ""])("passes %j on as text, and Escape restores", (text) => {
  const seen = vi.fn();
  openField(seen);
  fireEvent.focus(box());
  type(text);
  expect(seen).toHaveBeenLastCalledWith(text);
  expect(box().value).toBe(text);
  expect(box().getAttribute("aria-invalid")).toBe("true");
  press("Escape");
  expect(seen).toHaveBeenLastCalledWith(0.5);
  expect(box().value).toBe("0.5");
});

it("retains the typed text while it represents the same number", () => {
  const seen = vi.fn();
  openField(seen);
  for (const text of ["1", "1.", "1.0", "1.05"]) {
    type(text);
    expect(box().value).toBe(text);
  }
  expect(seen).toHaveBeenLastCalledWith(1.05);
});

it("retains a typed value of a form over a reload, and sends no other one", () => {
  const form = openBox({ isInForm: true });
  type("25.04");
  window.dispatchEvent(new Event("pagehide"));
  expect(form.sent.mock.calls).toEqual([[25]]);
  cleanup();
  const { sent } = openBox();
  type("25.04");
  window.dispatchEvent(new Event("pagehide"));
  expect(sent).not.toHaveBeenCalled();
});

it("retains a typed value of a form when its page closes, and sends no other one", () => {
  const form = openBox({ isInForm: true });
  type("25.04");
  cleanup();
  expect(form.sent.mock.calls).toEqual([[25]]);
  const { sent } = openBox();
  type("25.04");
  cleanup();
  expect(sent).not.toHaveBeenCalled();
});
