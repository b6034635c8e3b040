import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import type { ReactElement } from "react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { DEGREES } from "../../theme/signals";
import type { State } from "../../wire/types";
import { MapCard } from "./MapCard";
import { planeOver, xOf, yOf } from "./operatingMap";
import { ReferencesCard } from "./ReferencesCard";
import { TEXTS } from "./texts";

const LIMITS = {
  q_min: -80 / DEGREES,
  q_max: 80 / DEGREES,
  S_min: 7,
  S_max: 15,
  q_trip: 95 / DEGREES,
  tensions: [
    { F: 5, S: 6 },
    { F: 40, S: 16 },
  ],
};
const STATE = {
  mode: "run",
  touch: { felt: null },
  references: { q_ref: 10 / DEGREES, S_ref: 10, in_force: true },
  limits: LIMITS,
  tuning: { bank: null },
  link: { starts: 1 },
} as unknown as State;

function open(card: ReactElement, state = STATE): LiveStore {
  const store = new LiveStore(0);
  store.setState(state);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>{card}</LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
  return store;
}

async function commanded(): Promise<{ q_ref: number; S_ref: number }[]> {
  const puts = fetched.mock.calls.map(([request]) => request).filter(({ method }) => method === "PUT");
  return Promise.all(puts.map((request) => request.clone().json()));
}

/** Waits until pending requests are sent. */
const settled = () => new Promise((resolve) => setTimeout(resolve, 20));

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["performance"] }); // a command is pending for 1.2 s; fake time makes that independent of the machine
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const path = new URL(url).pathname;
    if (path === "/api/control")
      return Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" });
    if (path === "/api/session") return Response.json({ name: "A. Operator", role: "operator" });
    return Response.json(path === "/api/banks" ? { banks: [] } : {});
  });
});
afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

const q_ref = () => screen.getByRole("slider", { name: "q_ref" });
const box = () => screen.getByRole("textbox", { name: "q_ref value [°]" }) as HTMLInputElement;

it.each([
  ["End", 80],
  ["Home", -80],
])("shows the target of %s, and sends it on Enter only", async (key, degrees) => {
  open(<ReferencesCard />);
  fireEvent.keyDown(q_ref(), { key });
  await settled();
  expect(await commanded()).toEqual([]);
  expect(box().value).toBe(degrees.toFixed(1));
  expect(
    screen.getByText(fillText(TEXTS.referenceNotSent, { value: "80.0°" }), { exact: false }),
  ).toBeTruthy();
  fireEvent.keyDown(q_ref(), { key: "Enter" });
  await waitFor(async () => expect(await commanded()).toEqual([{ q_ref: degrees / DEGREES, S_ref: 10 }]));
  expect(screen.queryByText(/not sent yet/)).toBeNull();
});

it("moves a target with the arrow keys without sending it, and discards it on Escape or blur", async () => {
  open(<ReferencesCard />);
  fireEvent.keyDown(q_ref(), { key: "End" });
  fireEvent.keyDown(q_ref(), { key: "ArrowLeft" });
  expect(box().value).toBe("79.0");
  fireEvent.keyDown(q_ref(), { key: "Escape" });
  expect(box().value).toBe("10.0");
  fireEvent.keyDown(q_ref(), { key: "Home" });
  fireEvent.blur(q_ref());
  expect(box().value).toBe("10.0");
  await settled();
  expect(await commanded()).toEqual([]);
});

it("sends a step of the arrow keys at once if no target is set", async () => {
  open(<ReferencesCard />);
  fireEvent.keyDown(q_ref(), { key: "ArrowRight" });
  await waitFor(async () => expect((await commanded())[0]?.q_ref).toBeCloseTo(11 / DEGREES, 9));
});

function clickMap(degrees: number, S: number): void {
  const map = screen.getByRole("img", { name: TEXTS.map });
  const size = { left: 0, top: 0, width: 400, height: 300 };
  vi.spyOn(map, "getBoundingClientRect").mockReturnValue({ ...size } as DOMRect);
  const plane = planeOver(STATE.limits, size.width, size.height);
  fireEvent.click(map, { clientX: xOf(plane, degrees / DEGREES), clientY: yOf(plane, S) });
}

it("sets a target with a click on the map, and sends the shown target with a button", async () => {
  open(<MapCard />);
  clickMap(30, 9);
  await settled();
  expect(await commanded()).toEqual([]);
  const shown = screen.getByRole("group", { name: TEXTS.mapTarget }).textContent ?? "";
  const [degrees, S] = (shown.match(/-?\d+\.\d+/g) ?? []).map(Number) as [number, number];
  expect(Math.abs(degrees - 30)).toBeLessThan(0.6);
  expect(Math.abs(S - 9)).toBeLessThan(0.1);
  fireEvent.click(screen.getByRole("button", { name: TEXTS.sendTarget }));
  await waitFor(async () => expect(await commanded()).toEqual([{ q_ref: degrees / DEGREES, S_ref: S }]));
  expect(screen.queryByText(/not sent yet/)).toBeNull();
});

it("sends nothing after a target is discarded", async () => {
  open(<MapCard />);
  clickMap(-40, 12);
  fireEvent.click(screen.getByRole("button", { name: TEXTS.discardTarget }));
  await settled();
  expect(await commanded()).toEqual([]);
  expect(screen.queryByText(/not sent yet/)).toBeNull();
});

it.each([
  [true, "7 to 15 N·m/rad"],
  [false, fillText(TEXTS.rangeAndRemark, { range: "7 to 15 N·m/rad", remark: TEXTS.measuredOnly })],
])("explains a number below the range (references active: %s)", (in_force, hint) => {
  const references = { q_ref: 0, S_ref: in_force ? 10 : 3.73, in_force };
  open(<ReferencesCard />, { ...STATE, references });
  expect(screen.getByLabelText<HTMLInputElement>("S_ref value [N·m/rad]").value).toBe(
    in_force ? "10.00" : "3.73",
  );
  expect(screen.getByText(hint)).toBeTruthy();
  expect(screen.queryAllByText(TEXTS.measuredOnly, { exact: false }).length).toBe(in_force ? 0 : 2);
});

function enter(label: string, text: string): void {
  const box = screen.getByLabelText(label);
  fireEvent.change(box, { target: { value: text } });
  fireEvent.keyDown(box, { key: "Enter" });
}
const Q_BOX = "q_ref value [°]";
const S_BOX = "S_ref value [N·m/rad]";

async function sent(count: number): Promise<void> {
  await waitFor(async () => expect((await commanded()).length).toBe(count));
  await act(settled); // wait for the response too
}

it("sends one reference with the last sent value of the other, before the state contains it", async () => {
  open(<ReferencesCard />);
  enter(Q_BOX, "30");
  enter(S_BOX, "12");
  enter(Q_BOX, "20");
  await sent(3);
  expect(await commanded()).toEqual([
    { q_ref: 30 / DEGREES, S_ref: 10 },
    { q_ref: 30 / DEGREES, S_ref: 12 },
    { q_ref: 20 / DEGREES, S_ref: 12 },
  ]);
});

it("sends the reference that the map set later, not the one that the card set before", async () => {
  open(
    <>
      <ReferencesCard />
      <MapCard />
    </>,
  );
  enter(S_BOX, "12");
  await sent(1);
  clickMap(30, 9);
  fireEvent.click(screen.getByRole("button", { name: TEXTS.sendTarget }));
  await sent(2);
  enter(Q_BOX, "20");
  await sent(3);
  const [, ofMap, last] = await commanded();
  expect(Math.abs((ofMap?.S_ref ?? 0) - 9)).toBeLessThan(0.1);
  expect(last).toEqual({ q_ref: 20 / DEGREES, S_ref: ofMap?.S_ref });
});

const activeReferences = (degrees: number, S_ref: number) => ({
  q_ref: degrees / DEGREES,
  S_ref,
  in_force: true,
});

it.each([
  ["before the command", [activeReferences(10, 10)], 12],
  ["of the first of two commands", [activeReferences(10, 11)], 12],
  ["of the command, then of another person's", [activeReferences(10, 12), activeReferences(0, 8)], 8],
  ["of another person's command", [activeReferences(0, 8)], 8],
  ["of a return to the earlier references", [activeReferences(10, 12), activeReferences(10, 10)], 10],
] as const)(
  "uses the state once it contains references other than the sent ones (%s)",
  async (_, states, S) => {
    const store = open(<ReferencesCard />);
    enter(S_BOX, "11");
    await sent(1);
    enter(S_BOX, "12");
    await sent(2);
    for (const references of states) act(() => store.setState({ ...STATE, references }));
    enter(Q_BOX, "20");
    await sent(3);
    expect((await commanded())[2]).toEqual({ q_ref: 20 / DEGREES, S_ref: S });
  },
);

it("drops a command that was refused", async () => {
  const store = open(<ReferencesCard />);
  const answers = fetched.getMockImplementation() as (request: Request) => Promise<Response>;
  const problem = { code: "out_of_range", message: "S_ref is too high" };
  fetched.mockImplementation(async (request) =>
    request.method === "PUT" ? Response.json({ error: problem }, { status: 422 }) : answers(request),
  );
  enter(S_BOX, "14");
  await sent(1);
  fetched.mockImplementation(answers);
  enter(Q_BOX, "20");
  await sent(2);
  expect((await commanded())[1]).toEqual({ q_ref: 20 / DEGREES, S_ref: 10 });
  expect(store.snapshot().state?.references.S_ref).toBe(10);
});

it.each([
  ["off", TEXTS.referencesNeedMode],
  ["experiment", TEXTS.referencesNeedMode],
  ["compliance", null],
] as const)("offers references only in modes that follow the operator's references (%s)", (mode, why) => {
  open(<ReferencesCard />, { ...STATE, mode });
  const box = screen.getByLabelText<HTMLInputElement>("S_ref value [N·m/rad]");
  expect(box.disabled).toBe(why !== null);
  expect(screen.getByRole("slider", { name: "S_ref" }).getAttribute("aria-disabled")).toBe(
    String(why !== null),
  );
  expect(screen.queryAllByText(TEXTS.referencesNeedMode, { exact: false }).length).toBe(why === null ? 0 : 2);
});

it("offers no reference during a contact reaction", () => {
  const felt = { F_ext_hat: 3, contact_N: 2, tick: 1 };
  open(<ReferencesCard />, { ...STATE, mode: "compliance", touch: { felt } } as unknown as State);
  expect(screen.getByLabelText<HTMLInputElement>("q_ref value [°]").disabled).toBe(true);
  expect(screen.getAllByText(TEXTS.referencesInContact, { exact: false }).length).toBe(2);
});
