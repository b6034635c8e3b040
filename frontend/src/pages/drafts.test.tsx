/** Text in boxes that send nothing yet survives leaving the page, until it is saved or discarded. */

import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { FormulaEditor } from "../charts/LayoutEditor";
import { LiveProvider } from "../live/react";
import { LiveStore } from "../live/store";
import type { BringUpStep, LogEntry, Run, State, Tuning } from "../wire/types";
import { StepCard } from "./bringUp/StepCard";
import { RemarkForm } from "./log/LogRows";
import { TEXTS as LOG } from "./log/texts";
import { ContactCard } from "./operate/ContactCard";
import { TuningChanges } from "./operate/TuningCard";
import { TEXTS as OPERATE } from "./operate/texts";
import { TUNING } from "./refusals.fixture";
import { NoteCard } from "./runs/RunDetail";
import { TriggerCard } from "./system/TriggerCard";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return replacement;
});

const RUN = { id: 7, kind: "tracking", end_state: "running", note: "saved" } as Run;
const ENTRY = { event: 3, note: "", tags: [] as string[] } as unknown as LogEntry;
const STAGING = { staging: true, values: {}, turn() {}, stage() {}, discard() {} };
const INPUT = { name: "tension", words: "tension", unit: "N", default: 20, minimum: 5, maximum: 45 };
const STEP = {
  id: "tare",
  title: "Tare",
  instruction: "",
  state: "never",
  why: "",
  result: null,
  running: null,
  inputs: [INPUT],
  blocked: "",
} as unknown as BringUpStep;
const STATE = {
  limits: { F_contact_min: 1, F_contact_max: 30 },
  touch: { contact_N: 0, learned: [], felt: null, sweep: null },
  tuning: TUNING,
  trial: null,
  trigger: null,
} as unknown as State;
const tuning = { ...TUNING, bank: null } as Tuning;
const onDone = vi.fn();

function open(what: ReactNode): void {
  const store = new LiveStore(0);
  store.setState(STATE);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>{what}</LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

beforeEach(() => {
  Object.defineProperty(document, "fonts", { value: new EventTarget(), configurable: true });
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const path = new URL(url).pathname;
    if (path === "/api/session") return Response.json({ name: "A. Operator", role: "operator" });
    return Response.json(path === "/api/formulas" ? { formulas: [] } : {});
  });
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

const box = (label: string) => screen.findByRole<HTMLInputElement>("textbox", { name: label });

const BOXES: [string, ReactNode, string][] = [
  ["Note", <NoteCard key="note" run={RUN} />, "typed"],
  ["Note on the event", <RemarkForm key="remark" entry={ENTRY} onDone={onDone} />, "typed"],
  ["Tags of the event", <RemarkForm key="tags" entry={ENTRY} onDone={onDone} />, "typed words"],
  [OPERATE.threshold, <ContactCard key="touch" />, "3.5"],
  [OPERATE.trialDuration, <TuningChanges key="trial" tuning={tuning} staged={STAGING} locked={null} />, "7"],
  ["Before [s]", <TriggerCard key="trigger" />, "2.5"],
  ["Tension [N]", <StepCard key="step" step={STEP} number={1} open />, "25"],
  ["Expression (signals in SI)", <FormulaEditor key="formula" />, "F_A + F_B"],
];

it.each(BOXES)("restores the text typed into %s after its page was left", async (label, what, text) => {
  open(what);
  const typed = await box(label);
  expect(typed.value).not.toBe(text);
  fireEvent.change(typed, { target: { value: text } });
  fireEvent.blur(typed);
  cleanup();
  open(what);
  await waitFor(async () => expect((await box(label)).value).toBe(text));
});

it("marks an unsaved note, and discards it on request", async () => {
  open(<NoteCard run={RUN} />);
  fireEvent.change(await box("Note"), { target: { value: "typed" } });
  fireEvent.click(await screen.findByRole("button", { name: "Discard the draft of the note" }));
  fireEvent.click(screen.getByRole("button", { name: "Discard draft" }));
  expect((await box("Note")).value).toBe("saved");
});

it("discards a note of an event on Cancel", async () => {
  open(<RemarkForm entry={ENTRY} onDone={onDone} />);
  fireEvent.change(await box("Note on the event"), { target: { value: "typed" } });
  fireEvent.click(screen.getByRole("button", { name: LOG.cancel }));
  await waitFor(() => expect(onDone).toHaveBeenCalled());
  cleanup();
  open(<RemarkForm entry={ENTRY} onDone={onDone} />);
  expect((await box("Note on the event")).value).toBe("");
});
