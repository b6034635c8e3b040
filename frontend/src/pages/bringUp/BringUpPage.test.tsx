import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor, within } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { dateTime } from "../../samples/format";
import type { AngleUnit } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { AngleUnitContext } from "../../service/api/preferences";
import type { BringUp, BringUpStep, State } from "../../wire/types";
import BringUpPage from "./BringUpPage";
import { TEXTS } from "./texts";

const WEIGHT = { name: "weight_1", words: "first weight", unit: "N", default: 10, minimum: 1, maximum: 50 };
const TURN = {
  name: "travel",
  words: "largest travel",
  unit: "rad",
  default: Math.PI / 60,
  minimum: 0.01,
  maximum: 0.1,
};
const RESULT: BringUpStep["result"] = {
  passed: true,
  text: "Both load cells answer along a line.",
  figures: [
    { words: "slope of load cell A", value: 10.02, unit: "N/V" },
    { words: "joint moved", value: Math.PI / 36, unit: "rad" },
    { words: "index of encoder q", value: null, unit: "1" },
  ],
  who: "A. Operator",
  at: "2026-11-22T10:00:00Z",
};

function step(id: BringUpStep["id"], title: string, more: Partial<BringUpStep> = {}): BringUpStep {
  const plain = { instruction: `how to do ${title}`, why: "", blocked: "" };
  return { id, title, ...plain, inputs: [], state: "never", result: null, running: null, ...more };
}

let role = "operator";
let view: BringUp;
let store: LiveStore;
let answerOf: (path: string) => Response | null;

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  role = "operator";
  store = new LiveStore(0);
  answerOf = () => null;
  fetched.mockReset().mockImplementation(async (request) => {
    const path = new URL(request.url).pathname;
    const answer = request.method === "POST" ? answerOf(path) : null;
    if (answer !== null) return answer;
    if (path === "/api/session") return Response.json({ name: "A. Operator", role });
    if (path === "/api/control")
      return Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" });
    return Response.json(view);
  });
});
afterEach(cleanup);

async function open(
  steps: BringUpStep[],
  angles: AngleUnit = "deg",
  drives_on: BringUp["drives_on"] = null,
  drives_locked = drives_on === false,
): Promise<void> {
  view = { applies: true, why_not: "", drives_on, drives_locked, drives_left: null, steps };
  show(angles);
  await screen.findByRole("list", { name: TEXTS.stepList });
  await waitFor(() => expect(asked("/api/session")).toHaveLength(1));
}

function show(angles: AngleUnit = "deg"): void {
  const client = new QueryClient({ defaultOptions: { queries: { retry: false } } });
  render(
    <MantineProvider>
      <QueryClientProvider client={client}>
        <LiveProvider store={store}>
          <AngleUnitContext value={angles}>
            <BringUpPage />
          </AngleUnitContext>
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

const asked = (path: string) =>
  fetched.mock.calls.map(([request]) => request).filter(({ url }) => new URL(url).pathname === path);
const card = (name: string) => within(screen.getByRole("region", { name }));
const start = (name: string) => screen.getByRole("button", { name });

it("states why commissioning is not needed, and offers no steps", async () => {
  view = {
    applies: false,
    why_not: "A simulator has no wires: there is nothing to bring up.",
    drives_on: null,
    drives_locked: false,
    drives_left: null,
    steps: [],
  };
  show();
  expect(await screen.findByText(view.why_not)).toBeTruthy();
  expect(screen.queryByRole("button")).toBeNull();
});

it("shows the steps in order with their status, and the readings at the next step", async () => {
  await open([
    step("wiring_test", "Wiring test", { state: "current", result: RESULT }),
    step("tare", "Tare", { state: "out_of_date", why: "done 40 days ago", result: RESULT }),
    step("zero", "Zero", { blocked: "The load cells have to be tared first." }),
    step("safety_module", "Safety module", { state: "failed", why: "it did not trip" }),
  ]);
  expect(screen.getAllByRole("heading", { level: 2 }).map(({ textContent }) => textContent)).toEqual([
    "1. Wiring test",
    "2. Tare",
    "3. Zero",
    "4. Safety module",
  ]);
  expect(document.body.textContent).toContain(fillText(TEXTS.someDone, { done: 1, count: 4 }));
  expect(card("1. Wiring test").getByText(TEXTS.current)).toBeTruthy();
  expect(card("2. Tare").getByText(TEXTS.outOfDate)).toBeTruthy();
  expect(card("2. Tare").getByText("Done 40 days ago")).toBeTruthy();
  expect(card("3. Zero").getByText(TEXTS.never)).toBeTruthy();
  expect(card("4. Safety module").getByText("It did not trip")).toBeTruthy();
  expect(screen.getAllByRole("region", { name: TEXTS.readings })).toHaveLength(1);
  expect(card("2. Tare").getByRole("region", { name: TEXTS.readings }).textContent).not.toContain("q");
});

it("does not start a blocked step, and states the reason", async () => {
  await open([step("zero", "Zero", { blocked: "The load cells have to be tared first." })]);
  expect(card("1. Zero").getByText("The load cells have to be tared first.")).toBeTruthy();
  expect(
    start(fillText(TEXTS.startStep, { action: TEXTS.start, step: "zero" })).getAttribute("aria-disabled"),
  ).toBe("true");
  fireEvent.click(start(fillText(TEXTS.startStep, { action: TEXTS.start, step: "zero" })));
  fireEvent.submit(screen.getByRole("form", { name: "Zero" }));
  expect(asked("/api/bring-up/zero")).toEqual([]);
});

it.each([
  ["deg", "Largest travel [°]", "0.573 to 5.72", "6", 6 * (Math.PI / 180)],
  ["rad", "Largest travel [rad]", "0.01 to 0.1", "0.08", 0.08],
] as const)(
  "sends the values of the boxes, with angles typed in %s as radians",
  async (angles, label, range, typed, sent) => {
    await open([step("calibrate", "Calibrate", { inputs: [WEIGHT, TURN] })], angles);
    expect(document.body.textContent).toContain(range);
    expect(screen.getByLabelText<HTMLInputElement>("First weight [N]").value).toBe("10");
    fireEvent.change(screen.getByLabelText(label), { target: { value: typed } });
    fireEvent.click(start(fillText(TEXTS.startStep, { action: TEXTS.start, step: "calibrate" })));
    await waitFor(() => expect(asked("/api/bring-up/calibrate")).toHaveLength(1));
    const body = await asked("/api/bring-up/calibrate")[0]?.clone().json();
    expect(body.values.weight_1).toBe(10);
    expect(body.values.travel).toBeCloseTo(sent, 12);
  },
);

it("sends nothing while a value is not a number", async () => {
  await open([step("calibrate", "Calibrate", { inputs: [WEIGHT] })]);
  fireEvent.change(screen.getByLabelText("First weight [N]"), { target: { value: "ten" } });
  fireEvent.click(start(fillText(TEXTS.startStep, { action: TEXTS.start, step: "calibrate" })));
  expect(card("1. Calibrate").getByText(TEXTS.notANumber)).toBeTruthy();
  expect(asked("/api/bring-up/calibrate")).toEqual([]);
});

it("shows a refusal at the box of the refused value", async () => {
  await open([step("calibrate", "Calibrate", { inputs: [WEIGHT] })]);
  const message = "first weight 99 N is above 50 N";
  answerOf = () =>
    Response.json(
      { error: { code: "out_of_range", message, path: ["values", "weight_1"] } },
      { status: 422 },
    );
  fireEvent.change(screen.getByLabelText("First weight [N]"), { target: { value: "99" } });
  fireEvent.click(start(fillText(TEXTS.startStep, { action: TEXTS.start, step: "calibrate" })));
  const box = screen.getByLabelText("First weight [N]");
  await waitFor(() => expect(box.getAttribute("aria-invalid")).toBe("true"));
  expect(document.body.textContent).toContain(message);
});

it.each(["rig", "virtual_card"] as const)(
  "states whether the virtual card simulates the requested action: %s",
  async (kind) => {
    store.setState({ link: { starts: 1 }, plant: { kind } } as unknown as State);
    const running = { phase: "wiring", elapsed_s: 1, confirm: "Turn the joint by hand, and confirm" };
    await open([step("wiring_test", "Wiring test", { running })]);
    const asked = await screen.findByRole("status", { name: TEXTS.whatToDo });
    expect(asked.textContent?.includes(TEXTS.confirmSimulates)).toBe(kind === "virtual_card");
  },
);

it("shows the request of a running step, and confirms or cancels it", async () => {
  const running = { phase: "turn the joint by 0.1\u202frad", elapsed_s: 3.2, confirm: "" };
  await open([step("wiring_test", "Wiring test", { state: "current" }), step("tare", "Tare", { running })]);
  const group = within(screen.getByRole("group", { name: fillText(TEXTS.stepRunning, { step: "Tare" }) }));
  expect(group.getByRole("status", { name: TEXTS.progress }).textContent).toBe("Turn the joint by 5.73°");
  expect(card("2. Tare").getByText(TEXTS.running)).toBeTruthy();
  expect(card("2. Tare").getByRole("region", { name: TEXTS.readings })).toBeTruthy();
  const confirm = () => screen.getByRole("button", { name: TEXTS.confirm });
  expect(confirm().getAttribute("aria-disabled")).toBe("true");
  fireEvent.click(confirm());
  expect(
    screen.queryByRole("button", { name: fillText(TEXTS.startStep, { action: TEXTS.start, step: "tare" }) }),
  ).toBeNull();
  view = {
    ...view,
    steps: [step("tare", "Tare", { running: { ...running, confirm: "Hang nothing on either tendon." } })],
  };
  await waitFor(() => expect(confirm().getAttribute("aria-disabled")).toBe("false"));
  expect(asked("/api/bring-up/confirm")).toEqual([]);
  fireEvent.click(confirm());
  expect(screen.getByRole("status", { name: TEXTS.whatToDo }).textContent).toBe(
    "Hang nothing on either tendon.",
  );
  await waitFor(() => expect(asked("/api/bring-up/confirm")).toHaveLength(1));
  fireEvent.click(screen.getByRole("button", { name: TEXTS.cancel }));
  await waitFor(() => expect(asked("/api/bring-up/cancel")).toHaveLength(1));
});

it("shows that the drives are off, and switches them on by the button", async () => {
  await open([step("zero", "Zero")], "deg", false);
  const drives = () => within(screen.getByRole("region", { name: TEXTS.drives }));
  expect(drives().getByText(TEXTS.drivesOff)).toBeTruthy();
  expect(drives().getByText(TEXTS.whileLocked, { exact: false })).toBeTruthy();
  view = { ...view, drives_on: true, drives_locked: false };
  fireEvent.click(drives().getByRole("button", { name: TEXTS.switchOn }));
  expect(await drives().findByText(TEXTS.drivesOn)).toBeTruthy();
  const sent = asked("/api/bring-up/drives");
  expect(await sent[0]?.clone().json()).toEqual({ on: true });
  expect(drives().getByRole("button", { name: TEXTS.switchOff })).toBeTruthy();
});

it("names the person who left the drives off before the service started", async () => {
  await open([step("zero", "Zero")], "deg", false);
  view = { ...view, drives_left: { who: "A. Operator", at: "2026-11-22T10:00:00Z" } };
  cleanup();
  show();
  const drives = within(await screen.findByRole("region", { name: TEXTS.drives }));
  const text = fillText(TEXTS.drivesLeft, { person: "A. Operator", time: dateTime("2026-11-22T10:00:00Z") });
  expect(drives.getByText(text, { exact: false })).toBeTruthy();
  expect(drives.getByRole("button", { name: TEXTS.switchOn })).toBeTruthy();
});

it("shows no drive lockout if Reset enables the drives", async () => {
  await open([step("zero", "Zero")], "deg", false, false);
  const drives = within(screen.getByRole("region", { name: TEXTS.drives }));
  expect(drives.getByText(TEXTS.untilReset, { exact: false })).toBeTruthy();
  expect(drives.queryByText(TEXTS.whileLocked, { exact: false })).toBeNull();
  fireEvent.click(drives.getByRole("button", { name: TEXTS.switchOff }));
  await waitFor(() => expect(asked("/api/bring-up/drives")).toHaveLength(1));
  expect(await asked("/api/bring-up/drives")[0]?.clone().json()).toEqual({ on: false });
});

it("shows no switch of the drives during a step", async () => {
  const running = { phase: "waiting", elapsed_s: 1, confirm: "Turn motor A." };
  await open([step("wiring_test", "Wiring test", { running })], "deg", false);
  expect(screen.getByRole("region", { name: TEXTS.drives }).textContent).toContain(TEXTS.drivesOff);
  expect(screen.queryByRole("button", { name: TEXTS.switchOn })).toBeNull();
  expect(screen.queryByRole("button", { name: TEXTS.switchOff })).toBeNull();
});

it("keeps typed values for the next execution of a step", async () => {
  const calibrate = step("calibrate", "Calibrate", { inputs: [WEIGHT] });
  await open([calibrate]);
  fireEvent.change(screen.getByLabelText("First weight [N]"), { target: { value: "12.5" } });
  view = { ...view, steps: [{ ...calibrate, running: { phase: "at rest", elapsed_s: 0, confirm: "" } }] };
  fireEvent.click(start(fillText(TEXTS.startStep, { action: TEXTS.start, step: "calibrate" })));
  const cancel = await screen.findByRole("button", { name: TEXTS.cancel });
  view = { ...view, steps: [calibrate] };
  fireEvent.click(cancel);
  await waitFor(() => expect(screen.getByLabelText<HTMLInputElement>("First weight [N]").value).toBe("12.5"));
});

it("shows a result with its values, person and time, and omits values that were not measured", async () => {
  await open([step("tare", "Tare", { state: "current", result: RESULT })]);
  const result = card("1. Tare").getByRole("region", { name: TEXTS.result });
  expect(result.textContent).toContain("Both load cells answer along a line.");
  expect(result.textContent).toContain("slope of load cell A10.02 N/V");
  expect(result.textContent).toContain("joint moved5.000°");
  expect(within(result).getByRole("img", { name: "not measured" })).toBeTruthy();
  expect(result.textContent).toMatch(/A\. Operator, 2026-11-22 \d\d:00:00/);
  expect(document.body.textContent).toContain(fillText(TEXTS.allDone, { count: 1 }));
});

it("shows a viewer no buttons", async () => {
  role = "viewer";
  const running = { phase: "waiting", elapsed_s: 1, confirm: "Hang the weight on." };
  await open([step("tare", "Tare", { running }), step("zero", "Zero", { inputs: [WEIGHT] })]);
  await waitFor(() => expect(screen.queryByRole("button")).toBeNull());
  expect(screen.getByText("Hang the weight on.")).toBeTruthy();
});
