import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, render, screen, within } from "@testing-library/react";
import { afterEach, expect, it, vi } from "vitest";
import type { Identification, Model } from "../../wire/types";
import { ActuatorResult } from "./ActuatorResult";

// the REST client takes hold of fetch when it is made, the charts of the screen
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
])("says of each model what the verdict above leaves out, and no reason twice", (G_q, G_S, ofG_q, ofG_S) => {
  const identification = { run: 3, usable: false, G_q, G_S } as unknown as Identification;
  render(
    <QueryClientProvider client={new QueryClient()}>
      <MantineProvider>
        <ActuatorResult identification={identification} />
      </MantineProvider>
    </QueryClientProvider>,
  );
  for (const [name, words] of [
    ["Model G_q", ofG_q],
    ["Model G_S", ofG_S],
  ] as const)
    expect(within(screen.getByRole("region", { name })).getByText(words)).toBeTruthy();
});
