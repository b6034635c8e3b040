import { act, cleanup, renderHook } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { Fault, Flight, Run, State, Task } from "../../wire/types";
import { setVisibility, shown, useBrowser } from "./browser.fixture";
import { whyNotNotified } from "./notifications";
import { describeRun, describeTrip, EventDetector, useNotifications } from "./useNotifications";

// the REST client captures fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});
const went = vi.hoisted(() => vi.fn());
vi.mock("wouter", () => ({ useLocation: () => ["/", went] }));
vi.mock("../api/preferences", () => ({
  usePreferences: () => ({ preferences: { notify: true, sound: false, angles: "deg" } }),
}));

const NOW = Date.parse("2026-03-01T12:00:00Z");
/** Difference between the service's clock and the page's. */
const AHEAD_MS = 3_600_000;

function state(part: object): State {
  return { plant: { kind: "simulator" }, link: { starts: 1 }, fault: null, task: null, ...part } as State;
}
const FAULT = { code: "force_limit", tick: 5000, message: "Too hard.", remedy: "Reset." };

/** A record of a trip `before_s` seconds before `NOW`. */
function record(id: number, tick: number, before_s: number): Flight {
  const at = new Date(NOW + AHEAD_MS - 1000 * before_s).toISOString();
  return {
    id,
    at,
    tick,
    kind: "trip",
    who: "",
    fault: "force_limit",
    text: "",
    run: null,
    before_s: 10,
    after_s: 5,
  };
}

let store: LiveStore;
let flights: Flight[];
let answer: () => Response;
const asked = (path: string) =>
  fetched.mock.calls.filter(([{ url }]) => new URL(url).pathname === path).length;

beforeEach(() => {
  vi.useFakeTimers({ now: NOW });
  useBrowser("granted");
  setVisibility(false);
  went.mockReset();
  flights = [];
  answer = () => Response.json({ error: { code: "unknown", message: "no such run" } }, { status: 404 });
  fetched.mockReset().mockImplementation(async ({ url }) => {
    const headers = { Date: new Date(Date.now() + AHEAD_MS).toUTCString() };
    return url.endsWith("/api/flights") ? Response.json({ flights }, { headers }) : answer();
  });
  store = new LiveStore(0);
  store.setState(state({ tick: 0 }));
  renderHook(() => useNotifications(), {
    wrapper: ({ children }) => <LiveProvider store={store}>{children}</LiveProvider>,
  });
});
afterEach(() => {
  cleanup();
  vi.useRealTimers();
  vi.restoreAllMocks();
});

const report = (part: object) => act(async () => store.setState(state(part)));
const pass = (ms: number) => act(() => vi.advanceTimersByTimeAsync(ms));
const click = () => act(async () => shown[0]?.onclick?.());

it("fetches no flight records before a click, and then opens that of the trip", async () => {
  vi.spyOn(window, "focus").mockReturnValue();
  // received 40 s late: the trip's record is the newest by then, and one of an earlier loop has the same tick
  flights = [record(8, 5000, 40), record(7, 5000, 90)];
  await report({ tick: 45_000, fault: FAULT });
  await pass(1);
  expect(shown).toHaveLength(1);
  expect(asked("/api/flights")).toBe(0);
  await click();
  await pass(1);
  expect(went.mock.calls).toEqual([["/flights/8"]]);
});

it("waits for the record of the trip, and opens neither an earlier loop's nor a later one", async () => {
  vi.spyOn(window, "focus").mockReturnValue();
  flights = [record(7, 5000, 90)];
  await report({ tick: 5100, fault: FAULT });
  await pass(1);
  await click();
  await pass(2000);
  expect(went).not.toHaveBeenCalled();
  flights = [record(9, 4990, -20), record(8, 5000, 0.1), ...flights];
  await pass(1000);
  expect(went.mock.calls).toEqual([["/flights/8"]]);
});

it("uses the state at the click if the tab was suspended, and finds the record that trips share", async () => {
  vi.spyOn(window, "focus").mockReturnValue();
  flights = [record(8, 3000, 0)];
  await report({ tick: 5000, fault: FAULT }); // reported by a message that is a minute old
  await report({ tick: 65_000, fault: FAULT });
  flights = [record(8, 3000, 62)];
  await pass(1);
  await click();
  await pass(1);
  expect(went.mock.calls).toEqual([["/flights/8"]]);
});

it("does not repeat the request for a run that does not exist", async () => {
  await report({ tick: 1, task: { run: 3 } });
  await report({ tick: 2 });
  for (let tick = 3; tick < 20; tick++) {
    await pass(1000);
    await report({ tick });
  }
  expect(asked("/api/runs/3")).toBe(1);
});

it("waits between attempts while the service is unavailable, and then reports the run", async () => {
  answer = () => Response.json({ error: { code: "unavailable", message: "busy" } }, { status: 503 });
  await report({ tick: 1, task: { run: 3 } });
  for (let tick = 2; tick < 52; tick++) {
    await report({ tick });
    await pass(100);
  }
  expect(asked("/api/runs/3")).toBe(1);
  const run = { id: 3, kind: "step", title: "Steps", end_state: "completed", end_reason: "" };
  answer = () => Response.json(run);
  await pass(1000);
  await report({ tick: 60 });
  await pass(1);
  expect(asked("/api/runs/3")).toBe(2);
  expect(shown).toHaveLength(1);
});

describe("events", () => {
  function fault(tick: number, code: Fault["code"] = "force_limit"): Fault {
    return {
      code,
      tick,
      message: "A tendon pulled harder than its limit.",
      remedy: "Reset.",
      expected: false,
    };
  }

  interface StatePart {
    fault?: Fault;
    run?: number;
    phase?: Task["phase"];
    starts?: number;
    kind?: State["plant"]["kind"];
  }

  function state(part: StatePart): State {
    return {
      plant: { kind: part.kind ?? "simulator" },
      link: { starts: part.starts ?? 1 },
      fault: part.fault ?? null,
      task: part.run === undefined ? null : ({ run: part.run, phase: part.phase ?? "program" } as Task),
    } as State;
  }

  /** Events that the detector finds in each of the successive states. */
  function detected(...parts: StatePart[]) {
    const detector = new EventDetector();
    return parts.map((part) =>
      detector
        .detect(state(part))
        .map((one) => (one.kind === "trip" ? `trip ${one.starts}:${one.fault.tick}` : `over ${one.run}`)),
    );
  }

  describe("EventDetector", () => {
    it("reports no events from before the page was opened", () => {
      expect(detected({ fault: fault(10), run: 3 }, { fault: fault(10), run: 3 })).toEqual([[], []]);
    });

    it("reports each trip once", () => {
      const trips = detected({}, { fault: fault(10) }, { fault: fault(10) }, {}, { fault: fault(20) });
      expect(trips).toEqual([[], ["trip 1:10"], [], [], ["trip 1:20"]]);
    });

    it("reports no expected trip", () => {
      expect(detected({}, { fault: { ...fault(10), expected: true } }, {}, { fault: fault(20) })).toEqual([
        [],
        [],
        [],
        ["trip 1:20"],
      ]);
    });

    it("reports a trip at the same tick of another start of the loop", () => {
      expect(detected({ fault: fault(10) }, { fault: fault(10), starts: 2 })).toEqual([[], ["trip 2:10"]]);
    });

    it("reports the end of each run of a series, with and without a next run", () => {
      expect(detected({}, { run: 3 }, { run: 4 }, { run: 4 }, {})).toEqual([
        [],
        [],
        ["over 3"],
        [],
        ["over 4"],
      ]);
    });

    it("reports the end of a run in a pause once, also when the series resumes or ends", () => {
      const [three, paused] = [{ run: 3 }, { run: 3, phase: "paused" }] as const;
      expect(detected(three, paused, paused, { run: 4 }, {})).toEqual([[], ["over 3"], [], [], ["over 4"]]);
      expect(detected(three, paused, { run: 3, phase: "evaluation" }, {})).toEqual([[], ["over 3"], [], []]);
    });

    it("does not report a run that ended before the page was opened in a pause", () => {
      const paused = { run: 3, phase: "paused" } as const;
      expect(detected(paused, paused, { run: 4 }, {})).toEqual([[], [], [], ["over 4"]]);
    });

    it("reports a run whose pause is its first state", () => {
      expect(detected({}, { run: 3, phase: "paused" }, { run: 4 })).toEqual([[], [], ["over 3"]]);
    });

    it("reports the end of a run that was in progress when the page was opened", () => {
      expect(detected({ run: 3 }, {})).toEqual([[], ["over 3"]]);
    });

    it("reports a trip and the end of its run", () => {
      expect(detected({ run: 3 }, { fault: fault(10) })).toEqual([[], ["trip 1:10", "over 3"]]);
    });

    it("reports no events of a replay", () => {
      expect(detected({ kind: "replay", run: 3 }, { kind: "replay", fault: fault(10) })).toEqual([[], []]);
    });
  });

  describe("texts", () => {
    const run = { id: 12, kind: "motor_identification", title: "Motor A", end_state: "completed" } as Run;

    it("state the kind, number and end state of a run", () => {
      const { tag, title, body } = describeRun({ ...run, end_reason: "" }, "deg");
      expect([tag, title, body]).toEqual([
        "sinew-run-12",
        "Motor identification, run 12: completed",
        "Motor A",
      ]);
    });

    it("state the reason of an incomplete run", () => {
      const text = describeRun({ ...run, end_state: "tripped", end_reason: "the joint left ±1 rad" }, "rad");
      expect(text.title).toBe("Motor identification, run 12: tripped");
      expect(text.body).toBe("Motor A · the joint left ±1 rad");
    });

    it("state the cause and remedy of a trip", () => {
      const text = describeTrip({ kind: "trip", fault: fault(10), starts: 2 }, "deg");
      expect(text.tag).toBe("sinew-trip-2-10");
      expect(text.title).toBe("Tripped: force limit");
      expect(text.body).toBe("A tendon pulled harder than its limit. Reset.");
    });

    it("describe STOP as a stop", () => {
      const stop = { ...fault(10, "stop_pressed"), message: "STOP was pressed." };
      expect(describeTrip({ kind: "trip", fault: stop, starts: 1 }, "deg").title).toBe("Stopped");
    });

    it("state a remedy for each reason without notifications", () => {
      for (const reason of ["default", "denied", "insecure", "missing"] as const) {
        expect(whyNotNotified(reason)).toMatch(/[Aa]llow them|Open the page there|Use another browser/);
      }
      expect(whyNotNotified("granted")).toBe("");
    });
  });
});
