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
  const told = vi.fn();
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
  render(<ValueBox {...props} onCommit={sent} onProblem={told} />, { wrapper: MantineProvider });
  return { sent, told };
}

it.each(NOT_NUMBERS)("commands nothing for %j, says so, and Escape restores", (text) => {
  const { sent, told } = openBox();
  type(text);
  press("Enter");
  expect(sent).not.toHaveBeenCalled();
  expect(box().value).toBe(text);
  expect(box().getAttribute("aria-invalid")).toBe("true");
  expect(told).toHaveBeenLastCalledWith(fillText(TEXTS.oddNotSent, { problem: `“${text}” is not a number` }));
  press("Escape");
  expect(box().value).toBe("12.0");
  expect(told).toHaveBeenLastCalledWith(null);
  fireEvent.blur(box());
  expect(sent).not.toHaveBeenCalled();
});

it.each([
  ["1e1", 10],
  ["−53", -53],
  ["7.26", 7.3],
  ["-0.01", 0],
  ["0,5", 0.5],
])("sends %j as the number that it is, rounded as it is shown", (text, value) => {
  const { sent } = openBox();
  type(text);
  press("Enter");
  fireEvent.blur(box());
  expect(sent.mock.calls).toEqual([[value]]);
});

it.each(["blur", "Escape"])(
  "sends nothing of a typed value on %s, restores the one before, and says so",
  (how) => {
    vi.useFakeTimers();
    const { sent, told } = openBox();
    type("25,04");
    expect(box().dataset.unsent).toBe("true");
    expect(told).toHaveBeenLastCalledWith(fillText(TEXTS.unsent, { value: "25.0°" }));
    if (how === "blur") fireEvent.blur(box());
    else press("Escape");
    expect(sent).not.toHaveBeenCalled();
    expect(box().value).toBe("12.0");
    expect(box().dataset.unsent).toBeUndefined();
    if (how === "blur") expect(told).toHaveBeenLastCalledWith(fillText(TEXTS.wasNotSent, { value: "25.0°" }));
    vi.advanceTimersByTime(10_000);
    expect(told).toHaveBeenLastCalledWith(null);
    vi.useRealTimers();
  },
);

it("keeps its value in a form, for the button that sends it", () => {
  const { sent } = openBox({ isInForm: true });
  type("25");
  expect(box().dataset.unsent).toBeUndefined();
  fireEvent.blur(box());
  expect(sent.mock.calls).toEqual([[25]]);
});

it("sends nothing when it is left as it was, or empty", () => {
  const { sent } = openBox();
  fireEvent.blur(box());
  press("Enter");
  type("");
  press("Enter");
  expect(sent).not.toHaveBeenCalled();
  expect(box().value).toBe("12.0");
});

it("steps with the arrows, and sends on Enter only", () => {
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

it.each([...NOT_NUMBERS, ""])("hands %j on as the text that it is, and Escape restores", (text) => {
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

it("keeps what is being typed while it means the same number", () => {
  const seen = vi.fn();
  openField(seen);
  for (const text of ["1", "1.", "1.0", "1.05"]) {
    type(text);
    expect(box().value).toBe(text);
  }
  expect(seen).toHaveBeenLastCalledWith(1.05);
});

it("keeps a value of a form that is typed when the page is loaded again, and sends none of the others", () => {
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

it("keeps a value of a form that is typed when its page goes away, and sends none of the others", () => {
  const form = openBox({ isInForm: true });
  type("25.04");
  cleanup();
  expect(form.sent.mock.calls).toEqual([[25]]);
  const { sent } = openBox();
  type("25.04");
  cleanup();
  expect(sent).not.toHaveBeenCalled();
});
