/** Cards of a study state what they show: the statistic of a map, the reason for a missing list. */

import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import { fillText } from "../../samples/texts";
import type { MapPick } from "../../service/api/studies";
import type { StudyDetail, StudyMap } from "../../wire/types";
import { MapsCard } from "./MapsCard";
import StudiesPage from "./StudiesPage";
import { FiguresCard, SharesCard } from "./StudyPage";
import { TEXTS } from "./texts";

// the REST client captures fetch when it is created
vi.hoisted(() => vi.stubGlobal("fetch", () => Promise.reject(new TypeError("no way to the service"))));

afterEach(cleanup);

function show(content: ReactNode) {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  Object.defineProperty(document, "fonts", { value: new EventTarget(), configurable: true });
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  render(
    <QueryClientProvider client={new QueryClient({ defaultOptions: { queries: { retry: false } } })}>
      <MantineProvider>
        <LiveProvider store={new LiveStore(0)}>{content}</LiveProvider>
      </MantineProvider>
    </QueryClientProvider>,
  );
}

/** Returns counts for the cells of a map whose runs all have a value. */
function counts(...counted: number[][]): Pick<StudyMap, "counts" | "runs" | "intervals"> {
  return { counts: counted, runs: counted, intervals: counted.map((row) => row.map(() => null)) };
}

function detail(points: number): StudyDetail {
  const figure = (name: string, label: string, unit: string) => ({
    ...{ name, label, unit, count: points },
    ...{ missing: 0, unstable: 0, least: 1, p5: 1, median: 1, mean: 1, p95: 1, largest: 1, deviation: 0 },
  });
  return {
    study: { id: 1, points } as StudyDetail["study"],
    text: "",
    shares: [],
    axes: [
      { name: "lam_q", symbol: "λ_q", unit: "s", values: [10.0051, 10.0053] },
      { name: "lam_S", symbol: "λ_S", unit: "s", values: [0.5, 0.7] },
    ],
    figures: [figure("min_tension_N", "Smallest tension", "N"), figure("M_s_q", "Sensitivity peak", "1")],
    maps: [
      {
        figure: "min_tension_N",
        pick: "least",
        x: "lam_q",
        y: "lam_S",
        cells: [
          [10.0051, 10.0093],
          [10, null],
        ],
        unstable: [
          [false, false],
          [false, false],
        ],
        ...counts([1, 1], [1, 0]),
      },
      {
        figure: "M_s_q",
        pick: "mean",
        x: "lam_q",
        y: "lam_S",
        cells: [
          [1, 1],
          [1, 1],
        ],
        unstable: [
          [false, false],
          [false, false],
        ],
        ...counts([1, 1], [1, 0]),
      },
    ],
    rows: [],
  };
}

function mapOf(metric: string, statistic: string): string {
  return fillText(TEXTS.mapOf, { metric, statistic, count: 8 });
}

function titles(): (string | null)[] {
  return screen
    .getAllByRole("figure")
    .map((figure) => figure.querySelector("figcaption")?.textContent ?? null);
}

it("shows the statistic of the cells in the title of a map, and offers a choice", () => {
  const picked: MapPick[] = [];
  show(<MapsCard detail={detail(32)} pick="worst" onPick={(pick) => picked.push(pick)} />);
  expect(titles()).toEqual([
    mapOf("Smallest tension [N]", TEXTS.least),
    mapOf("Sensitivity peak", TEXTS.mean),
  ]);
  fireEvent.change(screen.getByRole("combobox", { name: TEXTS.cellValue }), { target: { value: "largest" } });
  expect(picked).toEqual(["largest"]);
});

it("shows no statistic in the title of a map with one run per cell", () => {
  show(<MapsCard detail={detail(4)} pick="worst" onPick={() => {}} />);
  expect(titles()).toEqual(["Smallest tension [N]", "Sensitivity peak"]);
});

it("marks cells with an unstable loop", () => {
  const found = detail(4);
  const [first] = found.maps;
  if (first === undefined) throw new Error("a map is missing");
  const maps = [
    {
      ...first,
      unstable: [
        [false, false],
        [false, true],
      ],
    },
  ];
  show(<MapsCard detail={{ ...found, maps }} pick="worst" onPick={() => {}} />);
  expect(titles()).toEqual([`Smallest tension [N]; ${TEXTS.mapUnstable}`]);
  expect(screen.getByText("∞")).toBeTruthy();
  expect(screen.getByText((text) => text.endsWith(`0.7: ${TEXTS.unstable}`))).toBeTruthy();
});

it("shows the number of runs without a value, and the interval of a share", () => {
  const found = detail(32);
  const [first] = found.maps;
  if (first === undefined) throw new Error("a map is missing");
  const few = {
    ...first,
    counts: [
      [8, 7],
      [8, 0],
    ],
    runs: [
      [8, 8],
      [8, 8],
    ],
  };
  const share = {
    ...{
      ...first,
      figure: "not_completed",
      pick: "share",
      cells: [
        [25, 0],
        [0, 0],
      ],
    },
    ...{
      counts: [
        [8, 8],
        [8, 8],
      ],
      runs: [
        [8, 8],
        [8, 8],
      ],
    },
    intervals: [
      [[7.1, 59], null],
      [null, null],
    ] as StudyMap["intervals"],
  };
  const shares = [
    {
      name: "not_completed",
      label: "Runs not completed",
      count: 2,
      of: 32,
      left_out: 0,
      percent: 6.2,
      low: 1,
      high: 20,
    },
  ];
  show(<MapsCard detail={{ ...found, maps: [few, share], shares }} pick="worst" onPick={() => {}} />);
  expect(titles()).toEqual([
    `${mapOf("Smallest tension [N]", TEXTS.least)}; ${fillText(TEXTS.mapWithout, { without: 9, runs: "32 runs" })}`,
    mapOf("Runs not completed [%]", TEXTS.share),
  ]);
  const labels = Array.from(document.querySelectorAll("svg text"), ({ textContent }) => textContent);
  expect(labels).toContain("n = 7 of 8");
  expect(labels).toContain("7.1 to 59, n = 8");
  expect(labels).toContain("λ_q [s]");
});

it("shows outcomes as shares with their interval, and why a statistic is missing", () => {
  const [first] = detail(32).figures;
  if (first === undefined) throw new Error("a figure is missing");
  show(
    <>
      <SharesCard
        shares={[
          {
            name: "not_completed",
            label: "Runs not completed",
            count: 3,
            of: 18,
            left_out: 0,
            percent: 16.7,
            low: 5.8,
            high: 39.2,
          },
          {
            name: "criteria_failed",
            label: "Criteria",
            count: 0,
            of: 0,
            left_out: 18,
            percent: null,
            low: null,
            high: null,
          },
        ]}
      />
      <FiguresCard figures={[{ ...first, count: 15, missing: 3, unstable: 2, p95: null, deviation: null }]} />
    </>,
  );
  const cells = (name: string) =>
    Array.from(
      screen.getByRole("table", { name }).querySelectorAll("tbody td"),
      ({ textContent }) => textContent,
    );
  expect(cells(TEXTS.outcomes).slice(1, 6)).toEqual(["3", "18", "16.7", "5.8 to 39.2", "0"]);
  expect(cells(TEXTS.outcomes).slice(7)).toEqual(["0", "0", "–", "–", "18"]);
  expect(cells(TEXTS.metrics).slice(2)).toEqual(["15 of 18", "1", "1", "1", "1", "–", "1", "–"]);
  expect(screen.getAllByLabelText(fillText(TEXTS.unstableIn, { runs: "2 runs" }))).toHaveLength(2);
});

it("gives cells and axis values distinct labels", () => {
  show(<MapsCard detail={detail(4)} pick="worst" onPick={() => {}} />);
  const texts = Array.from(screen.getAllByRole("figure")[0]?.querySelectorAll("text") ?? []);
  const labels = texts.map(({ textContent }) => textContent);
  for (const text of ["10.0051", "10.0053", "10.0093", "10"]) expect(labels).toContain(text);
});

it("shows why the list of studies is missing", async () => {
  show(<StudiesPage />);
  expect(await screen.findByText(/^The service cannot be reached/)).toBeTruthy();
  expect(screen.queryByText(TEXTS.loading)).toBeNull();
});
