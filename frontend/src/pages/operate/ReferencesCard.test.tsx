import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { cleanup, fireEvent, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { State, Tuning } from "../../wire/types";
import { MotionControl, whyNoReferences, whyNoStart } from "./ReferencesCard";
import { TEXTS } from "./texts";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

function open(motion: Tuning["motion"], disabled = false): void {
  const tuning = { motion, u_plan: 8.5, u_plan_min: 2, u_plan_max: 9 } as Tuning;
  render(
    <MantineProvider>
      <QueryClientProvider client={new QueryClient()}>
        <LiveProvider store={new LiveStore(0)}>
          <MotionControl tuning={tuning} disabled={disabled} />
        </LiveProvider>
      </QueryClientProvider>
    </MantineProvider>,
  );
}

async function commanded(): Promise<unknown[]> {
  const puts = fetched.mock.calls.map(([request]) => request).filter(({ method }) => method === "PUT");
  return Promise.all(puts.map((request) => request.clone().json()));
}

beforeEach(() => {
  vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener() {}, removeEventListener() {} }));
  vi.stubGlobal(
    "ResizeObserver",
    class {
      observe() {}
      unobserve() {}
      disconnect() {}
    },
  );
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const path = new URL(url).pathname;
    if (path === "/api/control")
      return Response.json({ epoch: 1, page: "k".repeat(16), name: "A. Operator" });
    return Response.json(path === "/api/session" ? { name: "A. Operator", role: "operator" } : {});
  });
});
afterEach(cleanup);

const radio = (name: string) => screen.getByRole<HTMLInputElement>("radio", { name });

it("offers the voltage limit in time-optimal motion only", () => {
  open("lambda");
  expect(radio("lambda").checked).toBe(true);
  expect(screen.queryByRole("textbox", { name: TEXTS.voltageLimitBox })).toBeNull();
  cleanup();
  open("time-optimal");
  expect(radio("time-optimal").checked).toBe(true);
  expect(screen.getByRole<HTMLInputElement>("textbox", { name: TEXTS.voltageLimitBox }).value).toBe("8.5");
});

it("sends a chosen motion alone, and a voltage limit together with its motion", async () => {
  open("lambda");
  fireEvent.click(radio("time-optimal"));
  await waitFor(async () => expect(await commanded()).toEqual([{ motion: "time-optimal" }]));
  cleanup();
  fetched.mockClear();
  open("time-optimal");
  const box = screen.getByRole("textbox", { name: TEXTS.voltageLimitBox });
  fireEvent.change(box, { target: { value: "6" } });
  fireEvent.keyDown(box, { key: "Enter" });
  await waitFor(async () => expect(await commanded()).toEqual([{ motion: "time-optimal", u_plan: 6 }]));
});

it("is disabled while the tuning cannot be changed", () => {
  open("time-optimal", true);
  expect(radio("lambda").disabled).toBe(true);
  expect(screen.getByRole<HTMLInputElement>("textbox", { name: TEXTS.voltageLimitBox }).disabled).toBe(true);
});

describe("reasons why a command is not offered", () => {
  const FREE = {
    mode: "run",
    legal_modes: ["experiment"],
    task: null,
    trial: null,
    unready: "",
    touch: { felt: null },
  } as unknown as State;
  const changed = (part: object) => ({ ...FREE, ...part }) as State;

  it("offers no start during a run or a trial", () => {
    expect(whyNoStart(FREE, "experiment", null)).toBeNull();
    expect(whyNoStart(changed({ task: { run: 3 } }), "experiment", null)).toBe(TEXTS.anotherRun);
    expect(whyNoStart(changed({ trial: { remaining_s: 4 } }), "experiment", null)).toContain(
      "Keep or revert it first",
    );
    expect(whyNoStart(changed({ mode: "off", legal_modes: ["pretension"] }), "experiment", null)).toBe(
      TEXTS.tendonsSlack,
    );
  });

  it("accepts references in run and compliance only, and none during a contact reaction", () => {
    expect(whyNoReferences(null, null)).toBe(TEXTS.referencesUnknown);
    for (const mode of ["run", "compliance"]) expect(whyNoReferences(changed({ mode }), null)).toBeNull();
    for (const mode of ["off", "pretension", "experiment", "tripped"]) {
      expect(whyNoReferences(changed({ mode }), null)).toBe(TEXTS.referencesNeedMode);
    }
    expect(whyNoReferences(changed({ mode: "off", player: { t: 1 } }), null)).toBe(TEXTS.referencesInReplay);
    expect(whyNoReferences(changed({ touch: { felt: { F: 6 } } }), null)).toBe(TEXTS.referencesInContact);
  });
});
