/** The chart of a metric is of the kind that is chosen, and its numbers are told apart. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { fireEvent, render, screen } from "@testing-library/react";
import { expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
vi.hoisted(() => vi.stubGlobal("fetch", () => new Promise(() => {})));

import { metricHistoryQuery, searchWordsQuery } from "../../service/queries";
import type { MetricHistory } from "../../wire/types";
import { MetricChart } from "./MetricChart";

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

it("shows no chart of another kind than the one chosen, and no number of two lines", async () => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  const complained = vi.spyOn(console, "error");
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  client.setQueryData(searchWordsQuery.queryKey, {
    ...{ station: "", stations: [""], fields: [], ends: [], verdicts: [], tags: [], values: {} },
    kinds: ["tracking", "compliance"],
  });
  const told = (kind: string) => metricHistoryQuery(kind, "", "", false).queryKey;
  client.setQueryData(told("tracking"), history("tracking", "Smallest tension"));
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
  fireEvent.change(screen.getByRole("combobox", { name: "Kind" }), { target: { value: "compliance" } });
  expect(screen.queryByRole("figure")).toBeNull();
  expect(screen.getByText("Loading …")).toBeTruthy();
  expect(screen.getByRole<HTMLSelectElement>("combobox", { name: "Metric" }).disabled).toBe(true);
  client.setQueryData(told("compliance"), history("compliance", "Sensor delay"));
  expect(await screen.findByRole("figure", { name: "Sensor delay" })).toBeTruthy();
  expect(complained).not.toHaveBeenCalled();
});
