// @vitest-environment jsdom
/** Differences stand beside the run that they are to, and a figure that is none beside its reason. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
vi.hoisted(() => vi.stubGlobal("fetch", () => new Promise(() => {})));

import { comparisonQuery } from "../../service/queries";
import type { RunComparison } from "../../wire/types";
import { ComparisonCard } from "./ComparisonCard";

afterEach(cleanup);

const RUNS = [1, 2, 3];
const REASON = "one step was not measured; the one at 2 s: it came to 66 % of its way";

/** Peak voltages of 3 V, 4 V and 6 V beside a run of reference. */
function answer(reference: number): RunComparison {
  const volts = [3, 4, 6];
  const own = volts[RUNS.indexOf(reference)] ?? 0;
  return {
    reference,
    runs: RUNS.map((id) => ({
      id,
      title: "Tracking",
      kind: "tracking",
      station: "",
      who: "Ana",
      started: "2026-03-31T10:00:00Z",
      verdict: "",
    })),
    metrics: [
      {
        name: "peak_voltage_V",
        label: "Peak voltage",
        definition: "",
        unit: "V",
        values: volts.map((value) => ({ value, reason: "", difference: value - own, percent: null })),
      },
      {
        name: "overshoot_q_percent",
        label: "Overshoot of q",
        definition: "",
        unit: "%",
        values: [2, null, 2].map((value, index) => ({
          value,
          reason: index === 2 ? "" : REASON,
          difference: null,
          percent: null,
        })),
      },
    ],
  };
}

function show(): QueryClient {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  client.setQueryData(comparisonQuery(RUNS, 1).queryKey, answer(1));
  render(
    <QueryClientProvider client={client}>
      <MantineProvider>
        <ComparisonCard runs={RUNS} />
      </MantineProvider>
    </QueryClientProvider>,
  );
  return client;
}

function row(name: string): (string | null)[] {
  const found = screen.getByRole("row", { name: new RegExp(`^${name}`) });
  return Array.from(found.querySelectorAll("td")).map((cell) => cell.textContent);
}

it("shows differences to the run that is named, and none while those are under way", async () => {
  const client = show();
  expect(row("Peak voltage")).toEqual(["Peak voltage", "3.000", "4.000+1.000", "6.000+3.000", "V"]);
  fireEvent.change(screen.getByRole("combobox", { name: "Differences to" }), { target: { value: "2" } });
  expect(row("Peak voltage")).toEqual(["Peak voltage", "3.000", "4.000", "6.000", "V"]);
  expect(screen.getByRole("table").closest("[aria-busy]")?.getAttribute("aria-busy")).toBe("true");
  client.setQueryData(comparisonQuery(RUNS, 2).queryKey, answer(2));
  await vi.waitFor(() =>
    expect(row("Peak voltage")).toEqual(["Peak voltage", "3.000−1.000", "4.000", "6.000+2.000", "V"]),
  );
  expect(screen.getByRole("table").closest("[aria-busy]")?.getAttribute("aria-busy")).toBe("false");
});

it("says beside a figure why there is none, or why it is that of a part", () => {
  show();
  expect(row("Overshoot of q").slice(1)).toEqual([
    `2.000at least this: ${REASON}`,
    `not measured${REASON}`,
    "2.000",
    "%",
  ]);
});
