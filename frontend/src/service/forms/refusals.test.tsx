import { MantineProvider } from "@mantine/core";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { type ReactElement, useState } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { SettingField } from "../../components/fields";
import { Refusal } from "../../components/Refusal";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { SAMPLE } from "../../pages/experiments/document";
import { SequenceEditor } from "../../pages/experiments/SequenceEditor";
import { RequestError } from "../../wire/client";
import type { Setting } from "../../wire/types";
import { lastRefusal, RefusedFields } from "./refusals";

const AMPLITUDE = { name: "q_amplitude", meaning: "position steps", unit: "rad", default: 1 } as Setting;
const HOLD = { name: "q_hold", meaning: "position held", unit: "rad", default: 0 } as Setting;

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});
afterEach(() => {
  cleanup();
  vi.restoreAllMocks();
});

function refusal(path: (string | number)[] | undefined, message: string): RequestError {
  const place = path === undefined ? {} : { path };
  return new RequestError(message, 422, { code: "out_of_range", message, ...place });
}

function Form({ error, children }: { error: Error | null; children: (about: unknown) => ReactElement }) {
  const [changed, change] = useState(0);
  return (
    <MantineProvider>
      <LiveProvider store={new LiveStore(0)}>
        <RefusedFields error={error} about={changed}>
          {children(changed)}
          <button type="button" onClick={() => change(changed + 1)}>
            change
          </button>
        </RefusedFields>
      </LiveProvider>
    </MantineProvider>
  );
}

function open(children: (error: Error | null, about: unknown) => ReactElement, error: Error) {
  const tree = (now: Error | null) => <Form error={now}>{(about) => children(now, about)}</Form>;
  const { rerender } = render(tree(null));
  rerender(tree(error));
}

const settings = (error: Error | null, about: unknown) => (
  <>
    <SettingField setting={AMPLITUDE} value={2.1} onChange={() => undefined} />
    <details>
      <SettingField setting={HOLD} value={0} onChange={() => undefined} />
    </details>
    <Refusal error={error} about={about} />
  </>
);
const SENTENCE = "position steps: 120.321° is outside 0.572958 to 80.214°; choose a value between the two";
const general = () => screen.getByRole("status", { name: "Refusal" });

it("shows the text of a refusal at its field, and marks and focuses the field", () => {
  open(settings, refusal(["settings", "q_amplitude"], SENTENCE));
  const box = screen.getByLabelText("Position steps [°]");
  expect(box.getAttribute("aria-invalid")).toBe("true");
  const described = box.getAttribute("aria-describedby")?.split(" ") ?? [];
  expect(described.map((id) => document.getElementById(id)?.textContent)).toContain(SENTENCE);
  expect(document.activeElement).toBe(box);
  expect(screen.getByLabelText("Position held [°]").getAttribute("aria-invalid")).not.toBe("true");
  expect(general().textContent).toBe("");
  expect(screen.getAllByText(SENTENCE)).toHaveLength(1);
});

it("opens the section that hides the field", () => {
  open(settings, refusal(["q_hold"], "position held: no"));
  expect(screen.getByRole("group").hasAttribute("open")).toBe(true);
  expect(document.activeElement).toBe(screen.getByLabelText("Position held [°]"));
});

it.each([undefined, ["seed"], []])("shows a refusal without a field below the form (%j)", (path) => {
  open(settings, refusal(path, SENTENCE));
  expect(general().textContent).toBe(SENTENCE);
  for (const box of screen.getAllByRole("textbox", { hidden: true })) {
    expect(box.getAttribute("aria-invalid")).not.toBe("true");
  }
});

it("shows a refusal below the row of the part, and marks only its box", () => {
  const parts = [0, 1, 2].map((q_ref) => ({ do: "step", q_ref, S_ref: 10, duration_s: 4 }));
  const composed = { ...SAMPLE, phases: [{ name: "all", title: "All", parts }] };
  const editor = (error: Error | null, about: unknown) => (
    <>
      <SequenceEditor document={composed} played={[]} onChange={() => undefined} />
      <Refusal error={error} about={about} />
    </>
  );
  const sentence = "phases 1, parts 3, q_ref: position reference: 114.592° is outside -80.214 to 80.214°";
  open(editor, refusal(["phases", 0, "parts", 2, "q_ref"], sentence));
  const box = screen.getByLabelText("q_ref [°] of part 1.3");
  expect(document.activeElement).toBe(box);
  const marked = screen.getAllByRole("textbox").filter((one) => one.getAttribute("aria-invalid") === "true");
  expect(marked).toEqual([box]);
  const described = box.getAttribute("aria-describedby")?.split(" ") ?? [];
  expect(described.map((id) => document.getElementById(id)?.textContent)).toContain(sentence);
  expect(general().textContent).toBe("");
});

it("hides a refusal when the refused value changes", () => {
  let now_ms = 0;
  vi.spyOn(performance, "now").mockImplementation(() => now_ms);
  open(settings, refusal(["q_amplitude"], SENTENCE));
  now_ms = 10_000; // long after the state that belongs to the refusal has arrived
  fireEvent.click(screen.getByRole("button", { name: "change" }));
  expect(screen.queryByText(SENTENCE)).toBeNull();
  expect(screen.getByLabelText("Position steps [°]").getAttribute("aria-invalid")).not.toBe("true");
});

it("returns the refusal of the last attempt only", () => {
  const [first, second] = [new Error("first"), new Error("second")];
  const attempt = (error: Error | null, submittedAt: number) => ({ error, submittedAt });
  expect(lastRefusal(attempt(first, 1), attempt(second, 2))).toBe(second);
  expect(lastRefusal(attempt(first, 3), attempt(second, 2))).toBe(first);
  expect(lastRefusal(attempt(first, 1), attempt(null, 2))).toBeNull();
});
