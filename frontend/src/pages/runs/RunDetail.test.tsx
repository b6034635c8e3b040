/** Order of the cards on the page of a run, and the display of metrics that were not measured. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen, within } from "@testing-library/react";
import { expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import { experimentQuery } from "../../service/api/experiments";
import { lineageQuery, runQuery } from "../../service/api/runs";
import type { Experiment, Lineage, Run } from "../../wire/types";
import { RunDetail } from "./RunDetail";
import { TEXTS } from "./texts";

// jsdom has no canvas; the tests check only the position of the curves
vi.mock("./RunCharts", async (original) => ({
  ...(await original<object>()),
  RunCharts: () => <div data-testid="curves" />,
}));
vi.mock("./ComparisonCard", async (original) => ({
  ...(await original<object>()),
  ComparedRuns: () => null,
}));

const RUN: Run = {
  id: 7,
  kind: "tracking",
  title: "Tracking",
  plant: "simulator",
  parameters: "lab",
  who: "A. Operator",
  started: "2026-03-04T10:20:30Z",
  ended: "2026-03-04T10:21:30Z",
  end_state: "completed",
  end_reason: "",
  duration_s: 21,
  samples: 21_000,
  missing_samples: 0,
  samples_deleted: null,
  settings: [
    { name: "q_duration_s", symbol: "t_q", unit: "s", meaning: "time each reference is held", value: 1.5 },
    { name: "interpolate", symbol: "interpolate", unit: "1", meaning: "gain scheduling", value: false },
  ],
  note: "",
  tags: [],
  station: "",
  origin: "",
  evaluation: "done",
  evaluation_problem: "",
  outcome: "incomplete",
  headline: {
    name: "min_tension",
    label: "Smallest tendon tension",
    value: 9.1,
    unit: "N",
    relation: ">",
    bound: 4,
  },
};

const REASON = "8 of 8 steps were not measured; the one at 2 s: it came to 66 % of its way in its time";
const EXPERIMENT: Experiment = {
  id: 7,
  name: "tracking",
  title: "Tracking",
  status: "completed",
  created: RUN.started,
  progress: 1,
  settings: {},
  outcome: "incomplete",
  verdict: "1 of 2 criteria was not measured: Overshoot of q.",
  metrics: [
    { name: "rise_q_s", label: "Rise time of q", definition: "", value: null, unit: "s", reason: REASON },
    { name: "peak_voltage_V", label: "Peak voltage", definition: "", value: 3, unit: "V", reason: "" },
  ],
  criteria: [
    {
      name: "overshoot_q",
      label: "Overshoot of q",
      value: null,
      bound: 2,
      relation: "<",
      unit: "%",
      passed: null,
      reason: REASON,
    },
    {
      name: "min_tension",
      label: "Smallest tendon tension",
      value: 9.1,
      bound: 4,
      relation: ">",
      unit: "N",
      passed: true,
      reason: "",
    },
  ],
  message: "",
};

const LINEAGE: Lineage = {
  software: "1.0.0",
  parameters: "lab",
  parameters_as_now: true,
  bank: null,
  entries: [],
  banks_built: [],
  runs_with_them: [],
  nodes: [],
} as unknown as Lineage;

function show(problem = "", run = RUN) {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  // the auto-sized box of the note listens for font events
  Object.defineProperty(document, "fonts", { value: new EventTarget(), configurable: true });
  const client = new QueryClient({ defaultOptions: { queries: { staleTime: Number.POSITIVE_INFINITY } } });
  client.setQueryData(runQuery(7).queryKey, run);
  client.setQueryData(experimentQuery(7).queryKey, EXPERIMENT);
  client.setQueryData(lineageQuery(7).queryKey, LINEAGE);
  render(
    <QueryClientProvider client={client}>
      <MantineProvider>
        <LiveProvider store={new LiveStore(0)}>
          <RunDetail id={7} others={[]} problem={problem} />
        </LiveProvider>
      </MantineProvider>
    </QueryClientProvider>,
  );
}

it("shows which part of its address is invalid", () => {
  const problem = fillText(TEXTS.invalidRuns, { parts: "abc" });
  show(problem);
  expect(screen.getByRole("alert").textContent).toBe(`${problem}.`);
  cleanup();
});

it.each([
  [0, TEXTS.noneMissing],
  [12, fillText(TEXTS.samplesMissing, { samples: 12 })],
  [null, TEXTS.missingUnknownWhy],
])("shows the completeness of a recording with %s missing samples", (missing, text) => {
  show("", { ...RUN, missing_samples: missing });
  expect(screen.getByText(TEXTS.completeness).nextElementSibling?.textContent).toContain(text);
  cleanup();
});

it("shows title, date and person, and the curves before all other cards", () => {
  show();
  expect(screen.getByRole("heading", { level: 1 }).textContent).toBe(
    `${TEXTS.runs} / ${fillText(TEXTS.runWithTitle, { run: 7, title: "Tracking" })}`,
  );
  const made = screen.getAllByText("A. Operator")[0]?.parentElement;
  for (const text of ["2026", "A. Operator", "Incomplete", "9.10 N", "> 4 N"]) {
    expect(made?.textContent).toContain(text);
  }
  const headings = screen.getAllByRole("heading", { level: 2 }).map((heading) => heading.textContent);
  expect(headings).toEqual([
    TEXTS.curves,
    TEXTS.result,
    fillText(TEXTS.run, { run: 7 }),
    TEXTS.noteAndDownloads,
    TEXTS.settings,
    TEXTS.lineage,
  ]);
  const settings = within(screen.getByRole("table", { name: TEXTS.settings }));
  const rows = settings.getAllByRole("row").map((row) =>
    within(row)
      .queryAllByRole("cell")
      .map((cell) => cell.textContent),
  );
  expect(rows.slice(1)).toEqual([
    ["time each reference is held", "t_q", "1.5", "s"],
    ["gain scheduling", "interpolate", "no", "–"],
  ]);
  expect(settings.getByRole("img", { name: "Dimensionless" })).toBeTruthy();
  for (const style of document.body.querySelectorAll("style")) style.remove();
  expect(document.body.textContent).not.toContain("{");
  const result = within(screen.getByRole("region", { name: TEXTS.result }));
  expect(result.getByText(EXPERIMENT.verdict)).toBeTruthy();
  expect(result.queryByText(/All .* passed/)).toBeNull();
  for (const table of ["Criteria", "Metrics"]) {
    const first = within(result.getByRole("table", { name: table })).getAllByRole("row")[1];
    expect(first?.textContent).toContain("not measured");
    expect(first?.textContent).toContain(REASON);
    expect(first?.textContent).not.toContain("–");
  }
});
