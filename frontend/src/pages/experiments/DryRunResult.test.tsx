import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, expect, it, vi } from "vitest";

// the REST client captures fetch when it is created, and the charts read the pixel density
const fetched = vi.hoisted(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

import { fillText } from "../../samples/texts";
import { useDryRun } from "../../service/api/experiments";
import type { ExperimentKind } from "../../wire/types";
import { DryRunResult } from "./DryRun";
import { TEXTS } from "./texts";

const TRACKING = "Tracking of position and stiffness";
const SIMULATED = fillText(TEXTS.simulated, { experiment: TRACKING, duration: "12.0 s" });
const KINDS = [
  { name: "tracking", title: TRACKING, settings: [] },
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

const PROGRESS = { under_way: true, doing: "program", played_s: 3, duration_s: 12 };
let aborted = 0;
let answers: ((response: Response) => void)[] = [];

beforeEach(() => {
  answers = [];
  aborted = 0;
  fetched.mockReset().mockImplementation(({ url, method, signal }) =>
    new URL(url).pathname.includes("/dry-run")
      ? method === "GET"
        ? Promise.resolve(Response.json(PROGRESS))
        : new Promise((resolve, reject) => {
            answers.push(resolve);
            signal.addEventListener("abort", () => {
              aborted += 1;
              reject(new DOMException("aborted", "AbortError"));
            });
          })
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
  return screen.queryByRole("region", { name: TEXTS.dryRun })?.textContent ?? "";
}

it("names the simulated experiment, and hides its result when another simulation starts", async () => {
  expect(shown()).toBe("");
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() => expect(shown()).toContain(fillText(TEXTS.simulating, { experiment: TRACKING })));
  answers[0]?.(Response.json({ ...RESULT, status: "completed" }));
  await waitFor(() => expect(shown()).toContain(SIMULATED));
  fireEvent.click(screen.getByText("sequence"));
  await waitFor(() => expect(shown()).toContain(fillText(TEXTS.simulating, { experiment: "Own sequence" })));
  expect(shown()).not.toContain("Tracking");
  answers[1]?.(Response.json({ error: { message: "no", code: "busy" } }, { status: 429 }));
  await waitFor(() => expect(shown()).toBe("")); // the open form shows the refusal
});

it("shows the refusal of a form that is no longer open", async () => {
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() => expect(answers).toHaveLength(1));
  answers[0]?.(Response.json({ error: { message: "the worker died", code: "died" } }, { status: 500 }));
  await waitFor(() =>
    expect(shown()).toContain(`${fillText(TEXTS.notSimulated, { experiment: TRACKING })} the worker died`),
  );
});

it("shows the progress; Cancel ends the connection and removes the card", async () => {
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() =>
    expect(shown()).toContain(fillText(TEXTS.progress, { simulated: "3.0 s", total: "12.0 s" })),
  );
  const bar = screen.getByRole("progressbar", { name: TEXTS.dryRunProgress });
  expect(bar.getAttribute("aria-valuenow")).toBe("25");
  fireEvent.click(screen.getByRole("button", { name: TEXTS.cancelDryRun }));
  await waitFor(() => expect(aborted).toBe(1));
  expect(shown()).toBe("");
  fireEvent.click(screen.getByText("tracking")); // a new dry run is possible
  await waitFor(() => expect(answers).toHaveLength(2));
  answers[1]?.(Response.json({ ...RESULT, status: "completed" }));
  await waitFor(() => expect(shown()).toContain(SIMULATED));
});

it("ends the dry run when its page closes", async () => {
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() => expect(answers).toHaveLength(1));
  cleanup();
  expect(aborted).toBe(1);
});

it("scrolls to the card when the result arrives", async () => {
  const scrolled = vi.fn();
  Element.prototype.scrollIntoView = scrolled;
  fireEvent.click(screen.getByText("tracking"));
  await waitFor(() => expect(answers).toHaveLength(1));
  expect(scrolled).not.toHaveBeenCalled();
  answers[0]?.(Response.json({ ...RESULT, status: "completed" }));
  await waitFor(() => expect(scrolled).toHaveBeenCalledTimes(1));
  expect(scrolled.mock.contexts[0]).toBe(screen.getByRole("region", { name: TEXTS.dryRun }).parentElement);
});
