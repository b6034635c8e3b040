import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act, cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
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

function told(part: Partial<State>): void {
  act(() => store.setState({ ...(store.snapshot().state ?? STATE), ...part }));
}

/** What the page asks for by itself. */
async function known(request: Request): Promise<Response> {
  const session = new URL(request.url).pathname === "/api/session";
  return new Response(JSON.stringify(session ? { name: "Ana", role } : { banks: [] }));
}

/** A click into the map that the service refuses. */
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

it("refuses a value until another one is in force, however that was sent", async () => {
  open();
  await refused(422, OUT_OF_RANGE);
  vi.advanceTimersByTime(5000);
  told({ mode: "compliance" });
  expect(message()).toBe(OUT_OF_RANGE.message);
  told({ references: { q_ref: 0.2, S_ref: 10, in_force: true } });
  expect(message()).toContain(TEXTS.mapHint);
  told({ references: { q_ref: 0, S_ref: 10, in_force: true } });
  expect(message()).toContain(TEXTS.mapHint);
});

it("says who holds control until somebody else does, or nobody", async () => {
  open();
  await refused(409, HELD);
  // the state that tells of the new holder may come after the refusal
  told({ holder: { name: "Ben", epoch: 8, page: true, silent_s: 0, lost: false } });
  expect(message()).toContain(HELD.message);
  expect(screen.getByRole("button", { name: "Take control" })).toBeTruthy();
  vi.advanceTimersByTime(5000);
  told({
    references: { q_ref: 0.2, S_ref: 10, in_force: true },
    holder: { name: "Ben", epoch: 8, page: true, silent_s: 1, lost: false },
  });
  expect(message()).toContain(HELD.message);
  told({ holder: null });
  expect(message()).toContain(TEXTS.mapHint);
  expect(screen.queryByRole("button", { name: "Take control" })).toBeNull();
});

it("says what the mode forbids until the mode is another", async () => {
  open();
  const problem = { code: "illegal_mode", message: "references are followed in run and compliance only" };
  await refused(409, problem);
  vi.advanceTimersByTime(5000);
  told({ tick: 9000 });
  expect(message()).toBe(problem.message);
  told({ mode: "off" });
  expect(message()).toContain(TEXTS.mapHint);
});

it("commands nothing by the click of a viewer, and does not offer it", async () => {
  role = "viewer";
  open();
  await waitFor(() => expect(message()).toBe(""));
  fireEvent.click(screen.getByRole("img", { name: TEXTS.map }), { clientX: 5, clientY: 5 });
  expect(fetched.mock.calls.filter(([request]) => request.method !== "GET")).toEqual([]);
});

it("offers no target while a recording is played", async () => {
  open();
  told({ mode: "off", player: { t: 1 } as State["player"] });
  await waitFor(() => expect(message()).toBe(""));
  fireEvent.click(screen.getByRole("img", { name: TEXTS.map }), { clientX: 5, clientY: 5 });
  expect(screen.queryByRole("group", { name: TEXTS.mapTarget })).toBeNull();
});
