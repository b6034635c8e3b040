import { act, cleanup, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../live/react";
import { LiveStore } from "../live/store";
import { pressStop } from "../stop/stop";
import type { State, StopProof } from "../wire/types";
import { StopResult } from "./StatusStrip";

// the REST client takes hold of fetch when it is made
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

const FIRST: StopProof = { arrived_tick: 1000, zero_tick: 1001, milliseconds: 0.83, paused_recording: false };
const LOST: StopProof = {
  arrived_tick: 9000,
  zero_tick: 9420,
  milliseconds: 420.31,
  paused_recording: false,
};

let store: LiveStore;

/** The service tells its state. */
function told(mode: State["mode"], tick: number, stop_proof: StopProof | null, alive = true): void {
  const state = { mode, tick, stop_proof, link: { alive, silent_s: 0, starts: 1 } } as State;
  act(() => store.setState(state));
}

function press(): void {
  act(pressStop);
}

const notice = () => screen.getByRole("alert", { name: "STOP" }).textContent;
const result = () => screen.getByRole("status", { name: "Stop result" }).textContent;

beforeEach(() => {
  store = new LiveStore(0);
  fetched.mockReset().mockImplementation(async () => new Response(JSON.stringify(FIRST)));
  render(
    <LiveProvider store={store}>
      <StopResult />
    </LiveProvider>,
  );
});

afterEach(cleanup);

it("shows a proof from the answer until the reset of its stop, and never again", async () => {
  told("run", 900, null);
  press();
  await waitFor(() => expect(result()).toContain("(tick 1001)"));
  // a state from before the stop that was under way says nothing about it
  told("run", 990, null);
  expect(result()).toContain("(tick 1001)");
  told("tripped", 1040, FIRST);
  expect(result()).toContain("(tick 1001)");
  told("off", 3000, null);
  expect(result()).toBe("");
  // pretension, run, and the soft stop of the operator
  for (const [mode, tick] of [
    ["pretension", 4000],
    ["run", 6000],
    ["stopping", 7000],
    ["off", 7700],
  ] as const) {
    told(mode, tick, null);
    expect(result(), mode).toBe("");
  }
});

it("shows the proof of the stop that took place, not of the one before", async () => {
  press();
  await waitFor(() => expect(result()).toContain("(tick 1001)"));
  told("tripped", 1040, FIRST);
  told("run", 6000, null);
  told("tripped", 9500, LOST);
  expect(result()).toBe("Zero volts in 420 ticks · 420.31 ms (tick 9420)");
});

it("says that a stop was not confirmed until the loop says that the motors rest", async () => {
  fetched.mockRejectedValue(new TypeError("no network"));
  told("run", 900, null);
  press();
  await waitFor(() => expect(notice()).toContain("NOT CONFIRMED"));
  told("run", 1500, null);
  told("off", 1600, null, false);
  expect(notice()).toContain("NOT CONFIRMED");
  expect(result()).toBe("");
  told("tripped", 2000, LOST);
  expect(result()).toContain("(tick 9420)");
});
