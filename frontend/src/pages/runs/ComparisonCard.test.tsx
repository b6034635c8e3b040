/** The comparison shows differences to the reference run only, and a reason for a missing metric. */
import { MantineProvider } from "@mantine/core";
import { cleanup, render, screen, within } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created
vi.hoisted(() => vi.stubGlobal("fetch", () => new Promise(() => {})));

import { fillText } from "../../samples/texts";
import type { RunComparison } from "../../wire/types";
import { TEXTS as EXPERIMENT_TEXTS } from "../experiments/texts";
import { ComparisonCard } from "./ComparisonCard";
import { askedOf, USUAL } from "./runAddress";
import { TEXTS } from "./texts";

afterEach(cleanup);

const RUNS = [1, 2, 3];
const REASON = "one step was not measured; the one at 2 s: it came to 66 % of its way";

/** Returns a comparison of peak voltages of 3 V, 4 V and 6 V with a reference run. */
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
      aligned_at_s: 0,
      offset_s: 0,
      not_aligned: "",
    })),
    settings: [
      { name: "time each reference is held t_q", unit: "s", values: [1.5, 1.5, null] },
      { name: "range of the joint q_max", unit: "rad", values: [Math.PI / 2, Math.PI, Math.PI / 2] },
      { name: "plant", unit: "1", values: ["simulator", "rig", "simulator"] },
    ],
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

/** Returns the card for a reference, with the answer for the reference `answered`. */
function card(reference: number, answered = reference) {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  return (
    <MantineProvider>
      <ComparisonCard
        asked={askedOf(RUNS, { ...USUAL, reference })}
        signal="q"
        comparison={answer(answered)}
        error={null}
      />
    </MantineProvider>
  );
}

function row(name: string): (string | null)[] {
  const found = screen.getByRole("row", { name: new RegExp(`^${name}`) });
  return Array.from(found.querySelectorAll("td")).map((cell) => cell.textContent);
}

function busy(): string | null | undefined {
  return screen
    .getByRole("table", { name: TEXTS.comparison })
    .closest("[aria-busy]")
    ?.getAttribute("aria-busy");
}

it("shows differences to the selected reference, and none while these are being computed", () => {
  const { rerender } = render(card(1));
  expect(row("Peak voltage")).toEqual(["Peak voltage", "3.000", "4.000+1.000", "6.000+3.000", "V"]);
  expect(busy()).toBe("false");
  rerender(card(2, 1));
  expect(row("Peak voltage")).toEqual(["Peak voltage", "3.000", "4.000", "6.000", "V"]);
  expect(busy()).toBe("true");
  rerender(card(2));
  expect(row("Peak voltage")).toEqual(["Peak voltage", "3.000−1.000", "4.000", "6.000+2.000", "V"]);
  expect(busy()).toBe("false");
});

it("shows different settings in the person's unit, and highlights values that differ from the reference", () => {
  render(card(2));
  expect(row("time each reference")).toEqual(["time each reference is held t_q", "1.5", "1.5", "–", "s"]);
  expect(row("range of the joint")).toEqual(["range of the joint q_max", "90", "180", "90", "°"]);
  expect(row("plant")).toEqual(["plant", "simulator", "rig", "simulator", "–"]);
  const table = within(screen.getByRole("table", { name: TEXTS.differentSettings }));
  const apart = table.getAllByText(/./, { selector: "strong" }).map(({ textContent }) => textContent);
  expect(apart).toEqual(["90", "90", "simulator", "simulator"]);
});

it("links to files of the comparison with the same reference", () => {
  render(card(2));
  const link = (name: string) => screen.getByRole("link", { name }).getAttribute("href");
  const asked = "run=1&run=2&run=3&reference=2&by=begin&step=q_ref&event=trip&number=1&signal=q";
  expect(link(TEXTS.tableFile)).toBe(`./api/run-comparison/table.csv?${asked}`);
  expect(link(fillText(TEXTS.curvesFile, { signal: "q" }))).toBe(`./api/run-comparison/curves.csv?${asked}`);
});

it("shows the reason of a metric that is missing or covers a part only", () => {
  render(card(1));
  expect(row("Overshoot of q").slice(1)).toEqual([
    `2.000${fillText(EXPERIMENT_TEXTS.boundedReason, { bound: EXPERIMENT_TEXTS.atLeast, reason: REASON })}`,
    `not measured${REASON}`,
    "2.000",
    "%",
  ]);
});
