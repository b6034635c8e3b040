import { act, cleanup, renderHook } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LiveProvider } from "../../live/react";
import { LiveStore } from "../../live/store";
import type { Fault, Flight, Run, State, Task } from "../../wire/types";
import { look, shown, useBrowser } from "./browser.fixture";
import { whyNotNotified } from "./notifications";
import { describeRun, describeTrip, EventDetector, useNotifications } from "./useNotifications";

// the REST client takes hold of fetch when it is made
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
/** The service's clock is not the page's. */
const AHEAD_MS = 3_600_000;

function state(part: object): State {
  return { plant: { kind: "simulator" }, link: { starts: 1 }, fault: null, task: null, ...part } as State;
}
const FAULT = { code: "force_limit", tick: 5000, message: "Too hard.", remedy: "Reset." };

/** A record of a trip so long before `NOW`. */
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
  look(false);
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

const tell = (part: object) => act(async () => store.setState(state(part)));
const pass = (ms: number) => act(() => vi.advanceTimersByTimeAsync(ms));
const click = () => act(async () => shown[0]?.onclick?.());

it("asks for no flight records until its notification is clicked, and leads to the one of the trip", async () => {
  vi.spyOn(window, "focus").mockReturnValue();
  // heard 40 s late: its own record is the newest by then, and one of an earlier loop has the same tick
  flights = [record(8, 5000, 40), record(7, 5000, 90)];
  await tell({ tick: 45_000, fault: FAULT });
  await pass(1);
  expect(shown).toHaveLength(1);
  expect(asked("/api/flights")).toBe(0);
  await click();
  await pass(1);
  expect(went.mock.calls).toEqual([["/flights/8"]]);
});

it("waits for the record of the trip, not taking that of an earlier loop, nor of a later one", async () => {
  vi.spyOn(window, "focus").mockReturnValue();
  flights = [record(7, 5000, 90)];
  await tell({ tick: 5100, fault: FAULT });
  await pass(1);
  await click();
  await pass(2000);
  expect(went).not.toHaveBeenCalled();
  flights = [record(9, 4990, -20), record(8, 5000, 0.1), ...flights];
  await pass(1000);
  expect(went.mock.calls).toEqual([["/flights/8"]]);
});

it("goes by the state of the click where the tab had slept, and finds the record that trips share", async () => {
  vi.spyOn(window, "focus").mockReturnValue();
  flights = [record(8, 3000, 0)];
  await tell({ tick: 5000, fault: FAULT }); // told by a message of a minute ago
  await tell({ tick: 65_000, fault: FAULT });
  flights = [record(8, 3000, 62)];
  await pass(1);
  await click();
  await pass(1);
  expect(went.mock.calls).toEqual([["/flights/8"]]);
});

it("asks no more for a run that is not there", async () => {
  await tell({ tick: 1, task: { run: 3 } });
  await tell({ tick: 2 });
  for (let tick = 3; tick < 20; tick++) {
    await pass(1000);
    await tell({ tick });
  }
  expect(asked("/api/runs/3")).toBe(1);
});

it("pauses between tries while the service cannot say, and tells the run once it can", async () => {
  answer = () => Response.json({ error: { code: "unavailable", message: "busy" } }, { status: 503 });
  await tell({ tick: 1, task: { run: 3 } });
  for (let tick = 2; tick < 52; tick++) {
    await tell({ tick });
    await pass(100);
  }
  expect(asked("/api/runs/3")).toBe(1);
  const run = { id: 3, kind: "step", title: "Steps", end_state: "completed", end_reason: "" };
  answer = () => Response.json(run);
  await pass(1000);
  await tell({ tick: 60 });
  await pass(1);
  expect(asked("/api/runs/3")).toBe(2);
  expect(shown).toHaveLength(1);
});

describe("what has happened", () => {
  function fault(tick: number, code: Fault["code"] = "force_limit"): Fault {
    return {
      code,
      tick,
      message: "A tendon pulled harder than its limit.",
      remedy: "Reset.",
      expected: false,
    };
  }

  interface LocalizedText {
    fault?: Fault;
    run?: number;
    phase?: Task["phase"];
    starts?: number;
    kind?: State["plant"]["kind"];
  }

  function state(part: LocalizedText): State {
    return {
      plant: { kind: part.kind ?? "simulator" },
      link: { starts: part.starts ?? 1 },
      fault: part.fault ?? null,
      task: part.run === undefined ? null : ({ run: part.run, phase: part.phase ?? "program" } as Task),
    } as State;
  }

  /** What is heard in each of the states, one after the other. */
  function heard(...parts: LocalizedText[]) {
    const happenings = new EventDetector();
    return parts.map((part) =>
      happenings
        .detect(state(part))
        .map((one) => (one.kind === "trip" ? `trip ${one.starts}:${one.fault.tick}` : `over ${one.run}`)),
    );
  }

  describe("Happenings", () => {
    it("has nothing of what was there when the page was opened", () => {
      expect(heard({ fault: fault(10), run: 3 }, { fault: fault(10), run: 3 })).toEqual([[], []]);
    });

    it("tells a trip once, and the next one again", () => {
      const trips = heard({}, { fault: fault(10) }, { fault: fault(10) }, {}, { fault: fault(20) });
      expect(trips).toEqual([[], ["trip 1:10"], [], [], ["trip 1:20"]]);
    });

    it("has nothing of a trip that is planned", () => {
      expect(heard({}, { fault: { ...fault(10), expected: true } }, {}, { fault: fault(20) })).toEqual([
        [],
        [],
        [],
        ["trip 1:20"],
      ]);
    });

    it("takes the same tick of another start of the loop for another trip", () => {
      expect(heard({ fault: fault(10) }, { fault: fault(10), starts: 2 })).toEqual([[], ["trip 2:10"]]);
    });

    it("tells each run of an order that is over, when the next begins and when none does", () => {
      expect(heard({}, { run: 3 }, { run: 4 }, { run: 4 }, {})).toEqual([[], [], ["over 3"], [], ["over 4"]]);
    });

    it("tells a run that is over when its order is paused, and not again when that goes on or ends there", () => {
      const [three, paused] = [{ run: 3 }, { run: 3, phase: "paused" }] as const;
      expect(heard(three, paused, paused, { run: 4 }, {})).toEqual([[], ["over 3"], [], [], ["over 4"]]);
      expect(heard(three, paused, { run: 3, phase: "evaluation" }, {})).toEqual([[], ["over 3"], [], []]);
    });

    it("has nothing of a run that was over in a pause when the page was opened", () => {
      const paused = { run: 3, phase: "paused" } as const;
      expect(heard(paused, paused, { run: 4 }, {})).toEqual([[], [], [], ["over 4"]]);
    });

    it("tells a run whose pause is the first that is heard of it", () => {
      expect(heard({}, { run: 3, phase: "paused" }, { run: 4 })).toEqual([[], [], ["over 3"]]);
    });

    it("tells a run that was under way when the page was opened", () => {
      expect(heard({ run: 3 }, {})).toEqual([[], ["over 3"]]);
    });

    it("tells a trip and the run that it has ended", () => {
      expect(heard({ run: 3 }, { fault: fault(10) })).toEqual([[], ["trip 1:10", "over 3"]]);
    });

    it("has nothing of what a recording plays", () => {
      expect(heard({ kind: "replay", run: 3 }, { kind: "replay", fault: fault(10) })).toEqual([[], []]);
    });
  });

  describe("the words", () => {
    const run = { id: 12, kind: "motor_identification", title: "Motor A", end_state: "completed" } as Run;

    it("are kind, number and end of a run", () => {
      const { tag, title, body } = describeRun({ ...run, end_reason: "" }, "deg");
      expect([tag, title, body]).toEqual([
        "sinew-run-12",
        "Motor identification, run 12: completed",
        "Motor A",
      ]);
    });

    it("say why a run ended otherwise", () => {
      const told = describeRun({ ...run, end_state: "tripped", end_reason: "the joint left ±1 rad" }, "rad");
      expect(told.title).toBe("Motor identification, run 12: tripped");
      expect(told.body).toBe("Motor A · the joint left ±1 rad");
    });

    it("are cause and remedy of a trip, whatever its message says", () => {
      const told = describeTrip({ kind: "trip", fault: fault(10), starts: 2 }, "deg");
      expect(told.tag).toBe("sinew-trip-2-10");
      expect(told.title).toBe("Tripped: force limit");
      expect(told.body).toBe("A tendon pulled harder than its limit. Reset.");
    });

    it("call a STOP a stop", () => {
      const stop = { ...fault(10, "stop_pressed"), message: "STOP was pressed." };
      expect(describeTrip({ kind: "trip", fault: stop, starts: 1 }, "deg").title).toBe("Stopped");
    });

    it("tell of each reason what to do", () => {
      for (const reason of ["default", "denied", "insecure", "missing"] as const) {
        expect(whyNotNotified(reason)).toMatch(/[Aa]llow them|Open the page there|Use another browser/);
      }
      expect(whyNotNotified("granted")).toBe("");
    });
  });
});
