/** A page without the control lease cannot end a trial, and cannot abort or pause a run. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return replacement;
});
// the charts are not under test
vi.mock("./LiveCharts", () => ({ LiveCharts: () => null }));

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { State, Tuning } from "../../wire/types";
import { STATE, TUNING } from "../refusals.fixture";
import { RunningCard } from "./RunningCard";
import { TuningChanges } from "./TuningCard";
import { TEXTS } from "./texts";

const NOTHING = { staging: false, values: {}, turn() {}, stage() {}, discard() {} };
const TASK = {
  run: 12,
  title: "Actuator identification",
  kind: "actuator_identification",
  number: 1,
  following: 2,
  phase: "program",
  part: null,
  elapsed_s: 1,
  duration_s: 10,
  pause_wanted: false,
};
const TRIAL = { ...TUNING, remaining_s: 5 };

function open(holder: State["holder"]): void {
  const store = new LiveStore(0);
  store.setState({
    ...STATE,
    mode: "identify",
    legal_modes: ["stopping"],
    task: TASK,
    trial: TRIAL,
    holder,
  } as unknown as State);
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={store}>
          <TuningChanges tuning={{ ...TUNING, bank: null } as Tuning} staged={NOTHING} locked={null} />
          <RunningCard place="beside" />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

beforeEach(() => {
  fetched
    .mockReset()
    .mockImplementation(async ({ url }) =>
      Response.json(url.endsWith("/api/session") ? { name: "Ana", role: "operator" } : {}),
    );
});
afterEach(cleanup);

const ENDS = [TEXTS.keep, TEXTS.revertNow, TEXTS.softAbort, TEXTS.pauseAfter];

function offered(name: string): boolean {
  const button = screen.getByRole<HTMLButtonElement>("button", { name });
  return !button.disabled && button.getAttribute("aria-disabled") !== "true";
}

it("enables the buttons while nobody holds control, and disables them while another person does", async () => {
  open(null);
  await waitFor(() => expect(ENDS.map(offered)).toEqual([true, true, true, true]));
  cleanup();
  open({ name: "Vera", page: true, epoch: 3, silent_s: 0, lost: false } as State["holder"]);
  await waitFor(() => expect(ENDS.map(offered)).toEqual([false, false, false, false]));
  expect(screen.getAllByText(/^Vera has control\./).length).toBeGreaterThan(0);
});
