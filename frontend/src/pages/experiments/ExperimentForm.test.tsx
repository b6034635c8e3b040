import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { useDryRun } from "../../service/api/experiments";
import { closeExplanation, currentExplanation } from "../../service/glossary";
import type { ExperimentKind, State } from "../../wire/types";
import { describeChanges, ExperimentForm, hasChoice, tuningChanges } from "./ExperimentForm";
import { TEXTS } from "./texts";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

const BANK = { id: 7, name: "lab", version: 2 };
const GEOMETRY = {
  lam_q: 0.5,
  lam_S: 0.42,
  lam_motor: 0.0854,
  b: 0,
  interpolate: false,
  motion: "lambda",
  u_plan: 8.5,
  bank: null,
};
const CHOSEN = {
  lam_q: 0.8,
  lam_S: 0.6,
  lam_motor: 0.09,
  b: 0.25,
  interpolate: true,
  motion: "time-optimal",
  u_plan: 6,
  bank: BANK,
};
const LENT = {
  lam_q: 1.5,
  lam_S: 1.2,
  lam_motor: 0.0854,
  b: 1,
  interpolate: false,
  motion: "lambda",
  u_plan: 8.5,
  bank: null,
};

type Tuned = typeof GEOMETRY | typeof CHOSEN;

/** Returns the declaration of a setting; its default may differ from the active value. */
function setting(name: string, fallback: boolean | number | string, unit = "1") {
  const bounds = typeof fallback === "number" ? { minimum: 0, maximum: 100 } : {};
  return { name, symbol: "", meaning: `what ${name} is`, unit, default: fallback, ...bounds };
}

const KIND: ExperimentKind = {
  name: "tracking",
  title: "Tracking",
  description: "",
  run_kind: "tracking",
  duration_s: 7,
  why_not: "",
  settings: [
    setting("q_duration_s", 8, "s"),
    setting("lam_q", 0.5, "s"),
    setting("lam_S", 0.42, "s"),
    setting("lam_motor", 0.0854, "s"),
    setting("b", 0),
    setting("bank", 0),
    setting("interpolate", false),
    { ...setting("motion", "lambda"), choices: ["lambda", "time-optimal"] },
    setting("u_plan", 8.5, "V"),
    setting("seed", 0),
  ],
};

function stateOf(tuning: Tuned, own_tuning: Tuned | null = null): State {
  const ranges = {
    lam_q_min: 0.3,
    lam_q_max: 10,
    lam_S_min: 0.25,
    lam_S_max: 10,
    lam_motor_min: 0.05,
    lam_motor_max: 0.2,
    u_plan_min: 2,
    u_plan_max: 9,
    entry: 0,
  };
  const legal_modes = ["experiment", "identify"];
  return {
    mode: "run",
    legal_modes,
    unready: "",
    task: null,
    tuning: { ...tuning, ...ranges },
    own_tuning,
    link: { alive: true, silent_s: 0, starts: 1 },
  } as unknown as State;
}

function answer(request: Request): Response {
  const path = new URL(request.url).pathname;
  if (path === "/api/session") return Response.json({ name: "A. Operator", role: "operator" });
  if (path === "/api/banks") return Response.json({ banks: [{ ...BANK, entries: [] }] });
  if (path === "/api/control") return Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" });
  if (path === "/api/experiments/queue") return Response.json({ items: [] }, { status: 201 });
  return Response.json({ id: 12 }, { status: 202 });
}

/** Returns the bodies of the requests to a path. */
async function sentTo(path: string): Promise<unknown[]> {
  const requests = fetched.mock.calls.map(([request]) => request);
  const mine = requests.filter(({ url, method }) => method === "POST" && new URL(url).pathname === path);
  return Promise.all(mine.map((request) => request.clone().json()));
}

function open(state: State, why_not = ""): LiveStore {
  const store = new LiveStore(0);
  store.setState(state);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>
          <Form why_not={why_not} />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
  return store;
}

function Form({ why_not }: { why_not: string }) {
  return <ExperimentForm kind={{ ...KIND, why_not }} onStarted={() => undefined} dryRun={useDryRun()} />;
}

/** Returns the values that the boxes show. */
function shownValues(): Record<string, unknown> {
  const number = (label: string) => Number((screen.getByLabelText(label) as HTMLInputElement).value);
  return {
    q_duration_s: number("What q_duration_s is [s]"),
    lam_q: number("What lam_q is [s]"),
    lam_S: number("What lam_S is [s]"),
    lam_motor: number("What lam_motor is [s]"),
    b: number("What b is"),
    bank: number(TEXTS.gainSource),
    interpolate: (screen.getByRole("switch", { name: /^What interpolate is/ }) as HTMLInputElement).checked,
    motion: (screen.getByLabelText("What motion is") as HTMLSelectElement).value,
    u_plan: number("What u_plan is [V]"),
    seed: number("What seed is"),
  };
}

function orderWith(tuning: Tuned) {
  const { bank, ...parts } = tuning;
  return { q_duration_s: 8, ...parts, bank: bank?.id ?? 0, seed: 0 };
}

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  fetched.mockReset().mockImplementation(async (request) => answer(request));
});
afterEach(() => {
  cleanup();
  localStorage.clear();
});

it("describes each field and its accepted values, without a further stop of the Tab key", async () => {
  open(stateOf(CHOSEN));
  const controls = [...document.querySelectorAll<HTMLElement>("form input, form select")];
  const explained = controls.map((control) => {
    fireEvent.focus(control);
    control.focus();
    return currentExplanation()?.entries.map(({ name, more }) => [name, more?.[0]?.[1] ?? ""]);
  });
  const accepted: Record<string, string> = {
    q_duration_s: "0 to 100 s",
    // the ranges of the state replace the declared ones
    lam_q: "0.3 to 10 s",
    lam_S: "0.25 to 10 s",
    lam_motor: "0.05 to 0.2 s",
    interpolate: "",
    motion: "lambda, time-optimal",
    u_plan: "2 to 9 V",
  };
  expect(explained).toEqual(KIND.settings.map(({ name }) => [[name, accepted[name] ?? "0 to 100"]]));
  closeExplanation();
  expect(document.querySelectorAll("form [tabindex='0']")).toHaveLength(1); // the explained terms of the form
});

const LOOP_SETTINGS = TEXTS.loopSettings.split("{")[0] ?? "";
const START = fillText(TEXTS.startExperiment, { experiment: "tracking" });
const BUTTONS = [
  [START, "/api/experiments"],
  [TEXTS.addToQueue, "/api/experiments/queue"],
  [TEXTS.dryRun, "/api/experiments/dry-run"],
] as const;

it.each([
  ["fresh", stateOf(GEOMETRY), GEOMETRY],
  ["bank active", stateOf(CHOSEN), CHOSEN],
  ["a run has a tuning of its own", stateOf(LENT, CHOSEN), CHOSEN],
] as const)("shows and sends the active tuning: %s", async (_name, state, expected) => {
  open(state);
  await waitFor(() => expect(shownValues()).toEqual(orderWith(expected)));
  for (const [button, path] of BUTTONS) {
    fireEvent.click(screen.getByRole("button", { name: button }));
    await waitFor(async () =>
      expect(await sentTo(path)).toEqual([{ name: "tracking", settings: shownValues() }]),
    );
  }
});

it("follows the active tuning, except for values that a person has changed", async () => {
  const store = open(stateOf(CHOSEN));
  fireEvent.change(screen.getByLabelText("What lam_q is [s]"), { target: { value: "0.4" } });
  act(() => store.setState(stateOf(GEOMETRY)));
  expect(shownValues()).toEqual({ ...orderWith(GEOMETRY), lam_q: 0.4 });
  expect(
    screen.getByText(`0.3 to 10; ${fillText(TEXTS.changedFrom, { origin: TEXTS.active, value: "0.5" })}`),
  ).toBeTruthy();
  fireEvent.click(screen.getByRole("button", { name: START }));
  await waitFor(async () =>
    expect(await sentTo("/api/experiments")).toEqual([{ name: "tracking", settings: shownValues() }]),
  );
});

it("sends geometric gains if they are chosen while a bank is active", async () => {
  open(stateOf(CHOSEN));
  await screen.findByText("bank lab v2");
  fireEvent.change(screen.getByLabelText(TEXTS.gainSource), { target: { value: "0" } });
  const geometric = (text: string) => text.startsWith(LOOP_SETTINGS) && /geometr/.test(text);
  expect(screen.getByText(geometric)).toBeTruthy();
  expect(
    screen.getByText(fillText(TEXTS.changedFrom, { origin: TEXTS.active, value: "bank 7" })),
  ).toBeTruthy();
  fireEvent.click(screen.getByRole("button", { name: START }));
  await waitFor(async () =>
    expect(await sentTo("/api/experiments")).toEqual([
      { name: "tracking", settings: { ...orderWith(CHOSEN), bank: 0 } },
    ]),
  );
});

it("offers only the dry run if the plant cannot run the experiment, and states the reason", async () => {
  open(stateOf(GEOMETRY), "nothing here pushes the joint by command");
  const start = await screen.findByRole<HTMLButtonElement>("button", { name: START });
  expect(start.ariaDisabled).toBe("true");
  expect(screen.getByRole<HTMLButtonElement>("button", { name: TEXTS.addToQueue }).disabled).toBe(true);
  expect(screen.getByRole<HTMLButtonElement>("button", { name: TEXTS.dryRun }).disabled).toBe(false);
  expect(screen.getByRole("form").textContent).toContain("Nothing here pushes the joint by command.");
});

it("shows a viewer no reason for a start that is not offered", async () => {
  fetched.mockImplementation(async (request) =>
    new URL(request.url).pathname === "/api/session"
      ? Response.json({ name: "V. Viewer", role: "viewer" })
      : answer(request),
  );
  open({ ...stateOf(GEOMETRY), mode: "off", legal_modes: ["pretension"] });
  await waitFor(() => expect(screen.queryByRole("button", { name: START })).toBeNull());
  expect(screen.getByRole("form").textContent).not.toContain("Pretension");
  cleanup();
  fetched.mockImplementation(async (request) => answer(request));
  open({ ...stateOf(GEOMETRY), mode: "off", legal_modes: ["pretension"] });
  await screen.findByRole("button", { name: START });
  expect(screen.getByRole("form").textContent).toContain("Pretension");
});

it.each(["5-3", "", "1e"])("sends nothing while a box contains %j", async (text) => {
  open(stateOf(GEOMETRY));
  fireEvent.change(screen.getByLabelText("What b is"), { target: { value: text } });
  for (const [button] of BUTTONS) fireEvent.click(screen.getByRole("button", { name: button }));
  fireEvent.submit(screen.getByRole("form"));
  expect(screen.getByRole("status", { name: "Refusal" }).textContent).toMatch(/^What b is: /);
  await Promise.resolve();
  expect(fetched.mock.calls.filter(([request]) => request.method === "POST")).toEqual([]);
});

describe("description of an order", () => {
  const KIND = {
    name: "tracking",
    settings: [
      { name: "q_hold", meaning: "joint position held during the stiffness pulses", unit: "rad", default: 0 },
      { name: "hold_s", meaning: "time the load is on, and off", unit: "s", default: 4 },
      { name: "pushes", meaning: "number of pushes; of the hand profile", unit: "1", default: 8 },
      { name: "controller", meaning: "control law; two for comparison", unit: "1", default: "cascade" },
      { name: "quick", meaning: "no pause between", unit: "1", default: false },
      { name: "lam_q", meaning: "tuning parameter of the position loop", unit: "s", default: 0.5 },
    ],
  } as unknown as ExperimentKind;

  it("describes the changed settings of a queued experiment in the reader's unit, without names of the code", () => {
    const changed = {
      q_hold: 0.2,
      pushes: 5,
      controller: "single-loop",
      quick: true,
      lam_q: 2,
    };
    const degrees = describeChanges({ ...changed, hold_s: 4 }, KIND, "deg");
    expect(degrees).toBe(
      "joint position held during the stiffness pulses: 11.4592°; number of pushes: 5; " +
        "control law: single-loop; no pause between: yes",
    );
    expect(describeChanges({ q_hold: 0.2 }, KIND, "rad")).toBe(
      "joint position held during the stiffness pulses: 0.2 rad",
    );
    expect(degrees).not.toMatch(/[a-z]+_[a-z]+/i);
    expect(describeChanges({ q_hold: 0, hold_s: 4 }, KIND, "deg")).toBe(TEXTS.defaultSettings);
  });

  it("describes the differences from the active tuning, and omits a voltage limit without effect", () => {
    const setting = (name: string, symbol: string, unit: string) => ({ name, symbol, unit, meaning: name });
    const kind = {
      name: "tracking",
      settings: [
        setting("q_hold", "q", "rad"),
        setting("lam_q", "λ_q", "s"),
        setting("motion", "motion", "1"),
        setting("u_plan", "U_plan", "V"),
      ],
    } as unknown as ExperimentKind;
    const change = (symbol: string, value: string, active: string) =>
      fillText(TEXTS.tuningChange, { symbol, value, active });
    const active = { lam_q: 0.5, motion: "time-optimal", u_plan: 8.5 };
    expect(tuningChanges({ q_hold: 0.2, ...active }, active, kind, "deg")).toBe("");
    expect(tuningChanges({ lam_q: 0.8, motion: "lambda", u_plan: 6 }, active, kind, "deg")).toBe(
      `${change("λ_q", "0.8 s", "0.5 s")}, ${change("motion", "lambda", "time-optimal")}`,
    );
    expect(tuningChanges({ lam_q: 0.5, motion: "time-optimal", u_plan: 6 }, active, kind, "deg")).toBe(
      change("U_plan", "6 V", "8.5 V"),
    );
  });

  it("has no choice between equal bounds", () => {
    const setting = (minimum: number | null, maximum: number | null) =>
      ({ name: "seed", minimum, maximum }) as unknown as ExperimentKind["settings"][number];
    expect(hasChoice(setting(0, 0))).toBe(false);
    expect(hasChoice(setting(0, 9))).toBe(true);
    expect(hasChoice(setting(null, null))).toBe(true);
  });
});
