import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen, within } from "@testing-library/react";
import { afterEach, describe, expect, it, test, vi } from "vitest";
import { fillText } from "../../samples/texts";
import type { Identification, Model } from "../../wire/types";
import {
  ActuatorResult,
  candidateOf,
  change,
  comparable,
  describeRecord,
  residualOutcome,
  sessionOf,
} from "./ActuatorResult";
import { TEXTS } from "./texts";

// the REST client captures fetch when it is created, the charts read the pixel density
vi.hoisted(() => {
  vi.stubGlobal("fetch", () => new Promise(() => {}));
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
});

afterEach(cleanup);

const MODEL = {
  structure: "lag_2",
  method: "arx",
  K: 0.05,
  gain_geometry: 0.05,
  T: 0.34,
  fit_percent: 97.1,
  parameters: { K: 0.05 },
  std_errors: { K: 0.001 },
};
const GOOD = {
  ...MODEL,
  grade: "usable",
  verdict: "Usable for tuning: white residuals.",
} as unknown as Model;
const POOR = {
  ...MODEL,
  grade: "usable with caution",
  verdict: "Usable with caution for tuning: friction.",
} as unknown as Model;

it.each([
  [GOOD, POOR, GOOD.verdict, "Usable with caution"],
  [POOR, GOOD, "Usable with caution", GOOD.verdict],
  [POOR, POOR, "Usable with caution", "Usable with caution"],
  [GOOD, GOOD, "Usable", "Usable"],
])(
  "shows the verdict on a model without its reasons if the identification shows them",
  (G_q, G_S, ofG_q, ofG_S) => {
    const identification = { run: 3, usable: false, G_q, G_S } as unknown as Identification;
    render(
      <QueryClientProvider client={new QueryClient()}>
        <MantineProvider>
          <ActuatorResult identification={identification} />
        </MantineProvider>
      </QueryClientProvider>,
    );
    for (const [name, words] of [
      [fillText(TEXTS.model, { name: "G_q" }), ofG_q],
      [fillText(TEXTS.model, { name: "G_S" }), ofG_S],
    ] as const)
      expect(within(screen.getByRole("region", { name })).getByText(words)).toBeTruthy();
  },
);

describe("candidates", () => {
  const MOTOR = {
    side: "A",
    fitted: { K_m: 2.9, T_m: 0.22 },
    std_errors: { K_m: 0.001, T_m: 0.002 },
    u_c: 0.07,
    u_c_std: 0.003,
    grade: "usable",
  };
  const MODEL = { K: 0.05, T: 0.342, K_std: null, T_std: 0.001, grade: "usable with caution" };

  function identification(run: number, parts: object): Identification {
    const nothing = {
      run,
      id: run,
      kind: "motor",
      estimate: run,
      G_q: null,
      G_S: null,
      motors: [],
      springs: [],
    };
    return { ...nothing, ...parts } as unknown as Identification;
  }

  test("returns the estimates of a motor with their standard errors", () => {
    const one = identification(3, { motors: [MOTOR] });
    expect(candidateOf(one, "A")).toEqual({
      run: 3,
      grade: "usable",
      estimates: [
        { name: "K_m", unit: "rad/(V·s)", value: 2.9, std: 0.001 },
        { name: "T_m", unit: "s", value: 0.22, std: 0.002 },
        { name: "u_c", unit: "V", value: 0.07, std: 0.003 },
      ],
    });
    expect(candidateOf(one, "B")).toBeNull();
    expect(candidateOf(one, "G_q")).toBeNull();
  });

  test("returns gain and sum of lags of a channel, without an undetermined error", () => {
    const one = identification(4, { kind: "actuator", G_S: MODEL });
    expect(candidateOf(one, "G_S")?.estimates).toEqual([
      { name: "K", unit: "N·m/rad²", value: 0.05, std: null },
      { name: "T", unit: "s", value: 0.342, std: 0.001 },
    ]);
  });

  test("compares identifications of the same kind with a model", () => {
    const [motor, other, empty] = [
      identification(1, {}),
      identification(2, {}),
      identification(3, { estimate: null }),
    ];
    const actuator = identification(4, { kind: "actuator" });
    expect(comparable(motor, [actuator, empty, other, motor])).toEqual([other]);
  });

  test("returns the runs of the day of the newest model, oldest first", () => {
    const at = (run: number, created: string, estimate: number | null = run) =>
      identification(run, { created, estimate });
    const all = [
      at(5, "2026-11-25T12:00:00", null),
      at(4, "2026-11-25T11:00:00"),
      at(3, "2026-11-25T10:00:00"),
      at(2, "2026-11-24T10:00:00"),
    ];
    expect(sessionOf(all)).toEqual([3, 4]);
    expect(sessionOf([])).toEqual([]);
  });

  test("formats a change in percent with its sign, and none relative to zero", () => {
    expect(change(2.2, 2)).toBe("+10.0 %");
    expect(change(1.9, 2)).toBe("−5.0 %");
    expect(change(2, 2)).toBe("0.0 %");
    expect(change(1, 0)).toBeNull();
  });

  test("describes the source of the predicted samples for each kind", () => {
    expect(describeRecord("actuator", 7, true)).toBe(fillText(TEXTS.ownThird, { run: 7 }));
    expect(describeRecord("motor", 7, false)).toBe(fillText(TEXTS.otherSteps, { run: 7 }));
  });
});

describe("residuals", () => {
  const TEST = {
    lags_s: [0.1, 0.2],
    correlation: [0.01, 0.3],
    bound: [0.28, 0.28],
    statistic: 3.01,
    critical: 2.81,
    level: 0.01,
    passed: false,
  };

  test("describes a residual test with its statistic and level", () => {
    expect(residualOutcome(TEST, "white", "coloured")).toBe(
      fillText(TEXTS.testOutcome, {
        outcome: "coloured",
        count: 2,
        statistic: "3.0",
        bound: "2.8",
        level: "1 %",
      }),
    );
    expect(residualOutcome({ ...TEST, passed: true }, "white", "coloured")).toMatch(/^white: /);
  });
});
