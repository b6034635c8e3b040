import { describe, expect, it } from "vitest";
import type { Fault, Run, State, Task } from "../wire/types";
import { Happenings, whyNotTold, wordsOfRun, wordsOfTrip } from "./log";

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
  const happenings = new Happenings();
  return parts.map((part) =>
    happenings
      .heard(state(part))
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
    const { tag, title, body } = wordsOfRun({ ...run, end_reason: "" }, "deg");
    expect([tag, title, body]).toEqual([
      "sinew-run-12",
      "Motor identification, run 12: completed",
      "Motor A",
    ]);
  });

  it("say why a run ended otherwise", () => {
    const told = wordsOfRun({ ...run, end_state: "tripped", end_reason: "the joint left ±1 rad" }, "rad");
    expect(told.title).toBe("Motor identification, run 12: tripped");
    expect(told.body).toBe("Motor A · the joint left ±1 rad");
  });

  it("are cause and remedy of a trip, whatever its message says", () => {
    const told = wordsOfTrip({ kind: "trip", fault: fault(10), starts: 2 }, "deg");
    expect(told.tag).toBe("sinew-trip-2-10");
    expect(told.title).toBe("Tripped: force limit");
    expect(told.body).toBe("A tendon pulled harder than its limit. Reset.");
  });

  it("call a STOP a stop", () => {
    const stop = { ...fault(10, "stop_pressed"), message: "STOP was pressed." };
    expect(wordsOfTrip({ kind: "trip", fault: stop, starts: 1 }, "deg").title).toBe("Stopped");
  });

  it("tell of each reason what to do", () => {
    for (const reason of ["default", "denied", "insecure", "missing"] as const) {
      expect(whyNotTold(reason)).toMatch(/allow it|Allow them|open the page there|use another one/);
    }
    expect(whyNotTold("granted")).toBe("");
  });
});
