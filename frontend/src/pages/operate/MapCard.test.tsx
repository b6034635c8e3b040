import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({
    matches: false,
    addEventListener: vi.fn(),
    removeEventListener: vi.fn(),
  }));
  return replacement;
});

import { MantineProvider } from "@mantine/core";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { State } from "../../wire/types";
import { MapCard } from "./MapCard";
import { TEXTS } from "./texts";

const STATE = {
  mode: "run",
  touch: { felt: null },
  references: { q_ref: 0, S_ref: 10, in_force: true },
  limits: { q_min: -1.4, q_max: 1.4, q_trip: 1.57, S_min: 8, S_max: 15, tensions: [] },
  tuning: { bank: null },
  link: { alive: true, silent_s: 0, starts: 1 },
  fault: null,
  task: null,
  trial: null,
  holder: null,
  pretension_done: true,
} as unknown as State;

const OUT_OF_RANGE = {
  code: "out_of_range",
  message: "q_ref is 85.94°: it has to be within -80.21 to 80.21°",
  quantity: "q_ref",
  value: 1.5,
  minimum: -1.4,
  maximum: 1.4,
  unit: "rad",
};
const HELD = { code: "control_held", message: "Ben holds control: take it over to command" };

let store: LiveStore;
let role: string;

function changeState(part: Partial<State>): void {
  act(() => store.setState({ ...(store.snapshot().state ?? STATE), ...part }));
}

/** Answers the requests that the page sends without a click. */
async function known(request: Request): Promise<Response> {
  const session = new URL(request.url).pathname === "/api/session";
  return new Response(JSON.stringify(session ? { name: "Ana", role } : { banks: [] }));
}

/** Sends a target from the map that the service refuses. */
async function refused(status: number, problem: { message: string }): Promise<void> {
  fetched.mockImplementation(async (request) =>
    request.method === "GET" ? known(request) : new Response(JSON.stringify({ error: problem }), { status }),
  );
  fireEvent.click(screen.getByRole("img", { name: TEXTS.map }), { clientX: 5, clientY: 5 });
  fireEvent.click(await screen.findByRole("button", { name: TEXTS.sendTarget }));
  await waitFor(() => expect(message()).toContain(problem.message));
}

const message = () => screen.getByRole("status", { name: "Refusal" }).textContent;

beforeEach(() => {
  vi.useFakeTimers({ toFake: ["performance"] });
  role = "operator";
  fetched.mockReset().mockImplementation(known);
  store = new LiveStore(0);
  store.setState(STATE);
});

function open(): void {
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient({ defaultOptions: { queries: { retry: false } } })}>
        <LiveProvider store={store}>
          <MapCard />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

afterEach(() => {
  cleanup();
  vi.useRealTimers();
});

it("shows a refused value until other references are active", async () => {
  open();
  await refused(422, OUT_OF_RANGE);
  vi.advanceTimersByTime(5000);
  changeState({ mode: "compliance" });
  expect(message()).toBe(OUT_OF_RANGE.message);
  changeState({ references: { q_ref: 0.2, S_ref: 10, in_force: true } });
  expect(message()).toContain(TEXTS.mapHint);
  changeState({ references: { q_ref: 0, S_ref: 10, in_force: true } });
  expect(message()).toContain(TEXTS.mapHint);
});

it("shows the holder of control until nobody holds it", async () => {
  open();
  await refused(409, HELD);
  // the state with the new holder may arrive after the refusal
  changeState({ holder: { name: "Ben", epoch: 8, page: true, silent_s: 0, lost: false } });
  expect(message()).toContain(HELD.message);
  expect(screen.getByRole("button", { name: "Take control" })).toBeTruthy();
  vi.advanceTimersByTime(5000);
  changeState({
    references: { q_ref: 0.2, S_ref: 10, in_force: true },
    holder: { name: "Ben", epoch: 8, page: true, silent_s: 1, lost: false },
  });
  expect(message()).toContain(HELD.message);
  changeState({ holder: null });
  expect(message()).toContain(TEXTS.mapHint);
  expect(screen.queryByRole("button", { name: "Take control" })).toBeNull();
});

it("shows a refusal by the mode until the mode changes", async () => {
  open();
  const problem = { code: "illegal_mode", message: "references are followed in run and compliance only" };
  await refused(409, problem);
  vi.advanceTimersByTime(5000);
  changeState({ tick: 9000 });
  expect(message()).toBe(problem.message);
  changeState({ mode: "off" });
  expect(message()).toContain(TEXTS.mapHint);
});

it("neither offers a target to a viewer nor sends one on a click", async () => {
  role = "viewer";
  open();
  await waitFor(() => expect(message()).toBe(""));
  fireEvent.click(screen.getByRole("img", { name: TEXTS.map }), { clientX: 5, clientY: 5 });
  expect(fetched.mock.calls.filter(([request]) => request.method !== "GET")).toEqual([]);
});

it("offers no target during a replay", async () => {
  open();
  changeState({ mode: "off", player: { t: 1 } as State["player"] });
  await waitFor(() => expect(message()).toBe(""));
  fireEvent.click(screen.getByRole("img", { name: TEXTS.map }), { clientX: 5, clientY: 5 });
  expect(screen.queryByRole("group", { name: TEXTS.mapTarget })).toBeNull();
});
