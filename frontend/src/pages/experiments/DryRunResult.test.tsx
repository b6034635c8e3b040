import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client takes hold of fetch when it is made, and so do the charts of the screen's density
const fetched = vi.hoisted(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { useDryRun } from "../../service/commands";
import type { ExperimentKind } from "../../wire/types";
import { DryRunResult } from "./DryRunResult";

const KINDS = [
  { name: "tracking", title: "Tracking of position and stiffness", settings: [] },
  { name: "sequence", title: "Own sequence", settings: [] },
] as unknown as ExperimentKind[];
const RESULT = { duration_s: 12, message: "", settings: {}, criteria: [], metrics: [], samples: null };

function Bench() {
  const dryRun = useDryRun();
  return (
    <>
      {KINDS.map(({ name }) => (
        <button key={name} type="button" onClick={() => dryRun.mutate({ name, settings: {} })}>
          {name}
        </button>
      ))}
      <DryRunResult dryRun={dryRun} kinds={KINDS} openForm="sequence" />
    </>
  );
}

let answers: ((response: Response) => void)[] = [];

beforeEach(() => {
  answers = [];
  fetched
    .mockReset()
    .mockImplementation(({ url }) =>
      new URL(url).pathname.endsWith("/dry-run")
        ? new Promise((resolve) => answers.push(resolve))
        : Promise.resolve(Response.json({ banks: [], experiments: [] })),
    );
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient({ defaultOptions: { queries: { retry: false } } })}>
        <Bench />
      </QueryClientProvider>
    </MantineProvider>,
  );
});
afterEach(cleanup);

function shown(): string {
  return screen.queryByRole("region", { name: "Dry run" })?.textContent ?? "";
}

it("says what was played, and keeps no result beside another that is being played", async () => {
  expect(shown()).toBe("");
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() => expect(shown()).toContain("Tracking of position and stiffness: being played"));
  answers[0]?.(Response.json({ ...RESULT, status: "completed" }));
  await waitFor(() => expect(shown()).toContain("Tracking of position and stiffness, 12.0 s simulated"));
  fireEvent.click(screen.getByText("sequence"));
  await waitFor(() => expect(shown()).toContain("Own sequence: being played"));
  expect(shown()).not.toContain("Tracking");
  answers[1]?.(Response.json({ error: { message: "no", code: "busy" } }, { status: 429 }));
  await waitFor(() => expect(shown()).toBe("")); // the form that is open tells it
});

it("tells what was refused of a form that is not open any more", async () => {
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() => expect(answers).toHaveLength(1));
  answers[0]?.(Response.json({ error: { message: "the worker died", code: "died" } }, { status: 500 }));
  await waitFor(() =>
    expect(shown()).toContain("Tracking of position and stiffness: not played. the worker died"),
  );
});
