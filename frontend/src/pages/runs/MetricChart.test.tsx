/** The chart of a metric shows the selected kind only, and its labels are distinct. */

import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { fireEvent, render, screen } from "@testing-library/react";
import { afterEach, describe, expect, it, vi } from "vitest";
import { dateTime } from "../../samples/format";
import { metricHistoryQuery, searchWordsQuery } from "../../service/api/runs";
import type { MetricHistory } from "../../wire/types";
import { MetricChart, scatter, steps } from "./MetricChart";
import { TEXTS } from "./texts";

// the REST client captures fetch when it is created
vi.hoisted(() => vi.stubGlobal("fetch", () => new Promise(() => {})));

vi.mock("@mantine/hooks", async (original) => ({
  ...(await original<typeof import("@mantine/hooks")>()),
  useElementSize: () => ({ ref: () => {}, width: 800, height: 360 }),
}));

function history(kind: string, label: string): MetricHistory {
  const metric = { name: label, label, unit: "N" };
  const points = [10.0051, 10.0093].map((value, index) => ({
    run: index + 1,
    at: `2026-03-0${index + 1}T10:00:00Z`,
    value,
  }));
  return { kind, metric, metrics: [metric], points, without: 0, left_out: 0 };
}

it("shows a chart of the selected kind only, with distinct labels", async () => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  const errors = vi.spyOn(console, "error");
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  client.setQueryData(searchWordsQuery.queryKey, {
    ...{ station: "", stations: [""], fields: [], ends: [], verdicts: [], tags: [], values: {} },
    kinds: ["tracking", "compliance"],
  });
  const queryKey = (kind: string) => metricHistoryQuery(kind, "", "", false).queryKey;
  client.setQueryData(queryKey("tracking"), history("tracking", "Smallest tension"));
  render(
    <QueryClientProvider client={client}>
      <MantineProvider>
        <MetricChart />
      </MantineProvider>
    </QueryClientProvider>,
  );
  const figure = screen.getByRole("figure", { name: "Smallest tension" });
  const labels = Array.from(figure.querySelectorAll("text")).map(({ textContent }) => textContent);
  expect(new Set(labels).size).toBe(labels.length);
  const points = screen
    .getAllByRole("link", { name: /^Run / })
    .map((link) => link.getAttribute("aria-label"));
  expect(new Set(points.map((point) => point?.split(": ")[1])).size).toBe(2);
  fireEvent.change(screen.getByRole("combobox", { name: TEXTS.kind }), { target: { value: "compliance" } });
  expect(screen.queryByRole("figure")).toBeNull();
  expect(screen.getByText(TEXTS.loading)).toBeTruthy();
  expect(screen.getByRole<HTMLSelectElement>("combobox", { name: TEXTS.metric }).disabled).toBe(true);
  client.setQueryData(queryKey("compliance"), history("compliance", "Sensor delay"));
  expect(await screen.findByRole("figure", { name: "Sensor delay" })).toBeTruthy();
  expect(errors).not.toHaveBeenCalled();
});

describe("scatter", () => {
  const DAY_MS = 86_400_000;

  afterEach(() => vi.unstubAllEnvs());

  it("places points between round values, in the order of their dates", () => {
    vi.stubEnv("TZ", "UTC");
    const points = [3.2, 4.9, 4.1].map((value, index) => ({
      run: index + 1,
      at: index * 10 * DAY_MS,
      value,
    }));
    const drawn = scatter(points, 800, 360);
    const [first, second, third] = drawn.points;
    expect([first?.x, third?.x]).toEqual([64, 788]);
    expect(second?.x).toBeCloseTo((64 + 788) / 2);
    const ticks = drawn.values.map(({ label }) => Number(label));
    expect([ticks[0], ticks.at(-1)]).toEqual([3, 5]);
    const [low, high] = [drawn.values[0]?.at ?? 0, drawn.values.at(-1)?.at ?? 0];
    for (const { y, value } of drawn.points) expect(y).toBeCloseTo(low + ((value - 3) / 2) * (high - low));
    expect(drawn.dates[0]?.label).toBe("1970-01-01");
    expect(drawn.dates.at(-1)?.label).toBe("1970-01-21");
    expect(drawn.line.match(/[ML]/g)?.join("")).toBe("MLL");
  });

  it("draws one point, equal points and no points", () => {
    const one = scatter([{ run: 1, at: DAY_MS, value: 0 }], 800, 360).points[0];
    expect(one?.x).toBeCloseTo((64 + 788) / 2);
    expect(Number.isFinite(one?.y)).toBe(true);
    expect(scatter([], 800, 360).points).toEqual([]);
    expect(scatter([{ run: 1, at: 0, value: 1 }], 0, 360).points).toEqual([]);
  });

  it("chooses round steps", () => {
    expect(steps(0.013, 0.087, 5)).toEqual([0, 0.02, 0.04, 0.06, 0.08, 0.1]);
    expect(steps(-3, 7, 5)).toEqual([-4, -2, 0, 2, 4, 6, 8]);
  });

  it("gives lines and points distinct labels, however close they are", () => {
    for (const [low, high] of [
      [10.0051, 10.0093],
      [0.1, 0.1 + 1e-7],
      [-3, 7],
      [1e5, 1e5 + 0.01],
      [5, 5 + 1e-15],
    ] as const) {
      const drawn = scatter(
        [low, high].map((value, index) => ({ run: index, at: index * DAY_MS, value })),
        800,
        360,
      );
      const labels = drawn.values.map(({ label }) => label);
      expect(new Set(labels).size, labels.join(" ")).toBe(labels.length);
      const lines = labels.map((label) => Number(label.replaceAll("−", "-")));
      const [first, last] = [lines[0] ?? 0, lines.at(-1) ?? 0];
      for (const point of drawn.points) {
        expect(Number.isFinite(point.y)).toBe(true);
        expect(Math.abs(Number(point.label.replace("−", "-")) - point.value)).toBeLessThan(
          (last - first) / 30,
        );
      }
    }
  });

  it("formats dates in the local time zone, each distinct from the others", () => {
    const start = Date.parse("2026-03-31T22:30:00Z");
    for (const zone of ["UTC", "Pacific/Auckland", "America/Los_Angeles"]) {
      vi.stubEnv("TZ", zone);
      for (const span of [0, 1000, 3_600_000, 2 * DAY_MS, 3.1 * DAY_MS, 8 * DAY_MS, 400 * DAY_MS]) {
        const drawn = scatter(
          [start, start + span].map((at, run) => ({ run, at, value: run })),
          800,
          360,
        );
        const labels = drawn.dates.map(({ label }) => label);
        expect(new Set(labels).size, `${zone}: ${labels.join(", ")}`).toBe(labels.length);
        if (span >= 3_600_000) expect(dateTime(new Date(start).toISOString())).toContain(labels[0]);
      }
    }
  });
});
