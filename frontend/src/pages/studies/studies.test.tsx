/** What is shown of studies says what it is: a map which of several runs, a list why it is not there. */
import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen } from "@testing-library/react";
import type { ReactNode } from "react";
import { afterEach, expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made
vi.hoisted(() => vi.stubGlobal("fetch", () => Promise.reject(new TypeError("no way to the service"))));

import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { MapPick } from "../../service/studies";
import type { StudyDetail } from "../../wire/types";
import { MapsCard } from "./MapsCard";
import StudiesPage from "./StudiesPage";

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

function detail(points: number): StudyDetail {
  const figure = (name: string, label: string, unit: string) => ({
    ...{ name, label, unit, count: points },
    ...{ unstable: 0, least: 1, median: 1, mean: 1, largest: 1 },
  });
  return {
    study: { id: 1, points } as StudyDetail["study"],
    text: "",
    axes: [
      { name: "lam_q", unit: "s", values: [10.0051, 10.0053] },
      { name: "lam_S", unit: "s", values: [0.5, 0.7] },
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
      },
    ],
    rows: [],
  };
}

function titles(): (string | null)[] {
  return screen
    .getAllByRole("figure")
    .map((figure) => figure.querySelector("figcaption")?.textContent ?? null);
}

it("says in the title of a map what its cells show, and lets it be chosen", () => {
  const picked: MapPick[] = [];
  show(<MapsCard detail={detail(32)} pick="worst" onPick={(pick) => picked.push(pick)} />);
  expect(titles()).toEqual([
    "Smallest tension [N]: the least of up to 8 runs",
    "Sensitivity peak: the mean of up to 8 runs",
  ]);
  fireEvent.change(screen.getByRole("combobox", { name: "Each cell" }), { target: { value: "largest" } });
  expect(picked).toEqual(["largest"]);
});

it("has nothing to say of a map whose cells are a run each", () => {
  show(<MapsCard detail={detail(4)} pick="worst" onPick={() => {}} />);
  expect(titles()).toEqual(["Smallest tension [N]", "Sensitivity peak"]);
});

it("hides no unstable loop", () => {
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
  expect(titles()).toEqual(["Smallest tension [N]; ∞: a loop is unstable"]);
  expect(screen.getByText("∞")).toBeTruthy();
  expect(screen.getByText(/0\.7: the loop of a run is unstable/)).toBeTruthy();
});

it("tells cells and the places of an axis apart", () => {
  show(<MapsCard detail={detail(4)} pick="worst" onPick={() => {}} />);
  const texts = Array.from(screen.getAllByRole("figure")[0]?.querySelectorAll("text") ?? []);
  const told = texts.map(({ textContent }) => textContent);
  for (const text of ["10.0051", "10.0053", "10.0093", "10"]) expect(told).toContain(text);
});

it("says why there is no list of studies", async () => {
  show(<StudiesPage />);
  expect(await screen.findByText(/^The service cannot be reached/)).toBeTruthy();
  expect(screen.queryByText("Loading …")).toBeNull();
});
