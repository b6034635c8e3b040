import { act, cleanup, render, screen, waitFor } from "@testing-library/react";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { LiveProvider } from "../live/react";
import { LiveStore } from "../live/store";
import { fillText } from "../samples/texts";
import { describeStop, pressStop } from "../stop/stop";
import type { State, StopProof } from "../wire/types";
import {
  currentStatus,
  partOf,
  StopResult,
  stopSentence,
  taskProgress,
  taskTitle,
  timeLeft,
} from "./StatusStrip";
import { TEXTS } from "./texts";

// the REST client stores fetch when it is created
const fetched = vi.hoisted(() => {
  const replacement = vi.fn<(request: Request) => Promise<Response>>();
  vi.stubGlobal("fetch", replacement);
  return replacement;
});

const FIRST: StopProof = { arrived_tick: 1000, zero_tick: 1001, milliseconds: 0.83, paused_recording: false };
const LOST: StopProof = {
  arrived_tick: 9000,
  zero_tick: 9420,
  milliseconds: 420.31,
  paused_recording: false,
};

let store: LiveStore;

/** Passes a state of the service to STOP. */
function receiveState(mode: State["mode"], tick: number, stop_proof: StopProof | null, alive = true): void {
  const state = { mode, tick, stop_proof, link: { alive, silent_s: 0, starts: 1 } } as State;
  act(() => store.setState(state));
}

function press(): void {
  act(pressStop);
}

const notice = () => screen.getByRole("alert", { name: "STOP" }).textContent;
const result = () => screen.getByRole("status", { name: TEXTS.stopResult }).textContent;

beforeEach(() => {
  store = new LiveStore(0);
  fetched.mockReset().mockImplementation(async () => new Response(JSON.stringify(FIRST)));
  render(
    <LiveProvider store={store}>
      <StopResult />
    </LiveProvider>,
  );
});

afterEach(cleanup);

it("shows a proof from the response until the reset of its stop, and not again", async () => {
  receiveState("run", 900, null);
  press();
  await waitFor(() => expect(result()).toContain("(tick 1001)"));
  // a state from before the stop does not change its proof
  receiveState("run", 990, null);
  expect(result()).toContain("(tick 1001)");
  receiveState("tripped", 1040, FIRST);
  expect(result()).toContain("(tick 1001)");
  receiveState("off", 3000, null);
  expect(result()).toBe("");
  // pretension, run, and the operator's soft stop
  for (const [mode, tick] of [
    ["pretension", 4000],
    ["run", 6000],
    ["stopping", 7000],
    ["off", 7700],
  ] as const) {
    receiveState(mode, tick, null);
    expect(result(), mode).toBe("");
  }
});

it("shows the proof of the latest stop, not of the one before", async () => {
  press();
  await waitFor(() => expect(result()).toContain("(tick 1001)"));
  receiveState("tripped", 1040, FIRST);
  receiveState("run", 6000, null);
  receiveState("tripped", 9500, LOST);
  expect(result()).toBe("Zero volts in 420 control steps · 420.31 ms (tick 9420)");
});

it("shows an unconfirmed stop until the control loop reports that the motors are off", async () => {
  fetched.mockRejectedValue(new TypeError("no network"));
  receiveState("run", 900, null);
  press();
  await waitFor(() => expect(notice()).toContain("NOT CONFIRMED"));
  receiveState("run", 1500, null);
  receiveState("off", 1600, null, false);
  expect(notice()).toContain("NOT CONFIRMED");
  expect(result()).toBe("");
  receiveState("tripped", 2000, LOST);
  expect(result()).toContain("(tick 9420)");
});

describe("status", () => {
  const PROOF = { arrived_tick: 1000, zero_tick: 1001, milliseconds: 0.83, paused_recording: false };

  function state(part: Partial<State>): State {
    return {
      mode: "run",
      link: { alive: true, silent_s: 0, starts: 1, restarting: "" },
      fault: null,
      task: null,
      problems: [],
      unready: "",
      pretension_done: true,
      recording_run: null,
      holder: null,
      touch: { felt: null },
      ...part,
    } as State;
  }

  const FAULT = {
    code: "force_limit",
    message: "F_A = 51 N",
    remedy: "Unload the joint.",
    tick: 9,
    expected: false,
  } as const;
  const TASK = {
    kind: "tracking",
    title: "",
    run: 12,
    elapsed_s: 6,
    duration_s: 24,
    phase: "program",
    part: null,
    number: 1,
    following: 0,
    pause_wanted: false,
  } as const;

  describe("currentStatus", () => {
    it("shows a lost connection before everything else", () => {
      const status = currentStatus(state({ fault: FAULT }), "down", 4200);
      expect(status.tone).toBe("warn");
      expect(status.text).toContain("4.2 s");
      expect(status.resettable).toBe(false);
    });

    it("shows nothing of the state from before a reconnection", () => {
      const before = currentStatus(state({ recording_run: 22 }), "live", 10, true, false);
      expect(before.text).toBe(TEXTS.statusWaiting);
      expect(currentStatus(state({ recording_run: 22 }), "live", 10).text).toBe(
        `${TEXTS.statusRun} ${fillText(TEXTS.statusRecording, { run: 22 })}`,
      );
    });

    it("states the consequence of a missing heartbeat of the page in control, if the joint may move", () => {
      const holder = {
        name: "Mara Stein",
        epoch: 3,
        page: true,
        silent_s: 2.5,
        lost: true,
      } as State["holder"];
      for (const mode of ["pretension", "run", "compliance"] as const) {
        const status = currentStatus(state({ mode, holder }), "live", 10);
        expect(status.tone).toBe("warn");
        expect(status.text).toContain("Mara Stein");
        expect(status.remedy).toContain("soft stop");
      }
      expect(currentStatus(state({ mode: "off", holder }), "live", 10).text).toBe(TEXTS.statusOff);
    });

    it("shows mode identify without a task as a step of the bring-up", () => {
      expect(currentStatus(state({ mode: "identify" }), "live", 10).text).toBe(TEXTS.statusBringUp);
    });

    it("names the force of a contact in compliance mode", () => {
      const touch = { felt: { F_ext_hat: -6.24 } } as State["touch"];
      const status = currentStatus(state({ mode: "compliance", touch }), "live", 10);
      expect(status).toMatchObject({ tone: "warn", text: fillText(TEXTS.statusContact, { force: "6.2" }) });
      expect(currentStatus(state({ mode: "compliance" }), "live", 10).text).toMatch(
        /^Compliance: joint loop open/,
      );
    });

    it("shows a fault before a task, with its remedy", () => {
      const status = currentStatus(state({ fault: FAULT, task: TASK }), "live", 10);
      expect(status).toMatchObject({
        tone: "fault",
        text: "F_A = 51 N",
        remedy: "Unload the joint.",
        resettable: true,
      });
    });

    it("shows a planned trip as calm, with a reset if there is one", () => {
      const played = { ...FAULT, expected: true };
      expect(currentStatus(state({ fault: played }), "live", 10)).toEqual({
        tone: "calm",
        text: "F_A = 51 N",
        remedy: "Unload the joint.",
        task: null,
        resettable: true,
      });
      const provoked = { ...played, remedy: "" };
      expect(currentStatus(state({ fault: provoked }), "live", 10)).toMatchObject({
        tone: "calm",
        resettable: false,
      });
    });

    it("distinguishes a dead control loop from a fault", () => {
      const dead = state({ link: { alive: false, silent_s: 2, starts: 1, restarting: "" } });
      expect(currentStatus(dead, "live", 10)).toMatchObject({ tone: "fault", resettable: true });
    });

    it("shows a planned restart of the loop as busy, with its purpose and its time", () => {
      const fault = { code: "watchdog_dead", message: "", remedy: "", tick: 1, expected: false } as const;
      const link = {
        alive: false,
        silent_s: 2,
        starts: 1,
        restarting: "with the parameters of run 3",
        restarting_s: 4.04,
      };
      for (const state_ of [state({ link }), state({ link, fault })]) {
        const shown = currentStatus(state_, "live", 10);
        expect(shown).toMatchObject({ tone: "busy", remedy: "", resettable: false });
        expect(shown.text).toContain("with the parameters of run 3, 4.0 s");
      }
    });

    it("names the task and its progress", () => {
      expect(currentStatus(state({ task: TASK }), "live", 10).text).toBe("Tracking, run 12: program");
      expect(taskProgress(TASK)).toBe(0.25);
    });

    it("names the part that runs, and the number of the run among several", () => {
      const part = { title: "Breaths", number: 2, of: 3, doing: null, left_s: 12.04, t: 20 };
      expect(partOf({ ...TASK, part })).toBe("part 2 of 3, Breaths, 12.0 s left");
      expect(partOf({ ...TASK, part: { ...part, number: 1, of: 1 } })).toBe("Breaths");
      expect(partOf({ ...TASK, phase: "pretension" })).toBe("pretension");
      expect(taskTitle({ ...TASK, number: 2, following: 2 })).toBe("Tracking, run 12, 2 of 4");
      expect(taskTitle({ ...TASK, number: 4, following: 0 })).toBe("Tracking, run 12, 4 of 4");
      // ended early, in the pause after the second of four: it is not the last of two
      expect(taskTitle({ ...TASK, phase: "evaluation", number: 2, following: 0 })).toBe("Tracking, run 12");
    });

    it("names the operating point and activity of an identification, counted over all runs", () => {
      const part = { title: "20 N", number: 2, of: 4, doing: "exciting", left_s: 12.04, t: 20 } as const;
      expect(taskTitle({ ...TASK, kind: "experiment", title: "Hold at rest" })).toBe("Hold at rest, run 12");
      const task = { ...TASK, kind: "actuator_identification", number: 2, following: 2 };
      expect(taskTitle(task)).toBe("Actuator identification, run 12, 2 of 4");
      expect(taskTitle({ ...task, part })).toBe("Actuator identification, run 12");
      expect(partOf({ ...task, part })).toBe("2 of 4: 20 N, exciting, 12.0 s left");
      expect(timeLeft({ ...task, part })).toBe("18.0 s left of 24.0 s, then 2 more runs");
      expect(timeLeft({ ...task, part, following: 1 })).toBe("18.0 s left of 24.0 s, then 1 more run");
    });

    it("never shows a negative remaining time", () => {
      expect(timeLeft(TASK)).toBe("18.0 s left of 24.0 s");
      expect(timeLeft({ ...TASK, elapsed_s: 25.5 })).toBe("1.5 s longer than expected");
      expect(timeLeft({ ...TASK, phase: "evaluation", elapsed_s: 24 })).toBe(TEXTS.computing);
    });

    it("shows problems of the service before a task", () => {
      const status = currentStatus(state({ task: TASK, problems: ["Disk full."] }), "live", 10);
      expect(status).toMatchObject({ tone: "warn", text: "Disk full.", task: TASK });
    });

    it("shows the next step only to those who may do it", () => {
      const off = state({ mode: "off" });
      expect(currentStatus(off, "live", 10)).toMatchObject({
        text: TEXTS.statusOff,
        remedy: TEXTS.nextOff,
      });
      expect(currentStatus(off, "live", 10, false)).toMatchObject({ text: TEXTS.statusOff, remedy: "" });
    });

    it("does not suggest Pretension if another step precedes it", () => {
      const off = state({ mode: "off", unready: "set the zero in the bring-up" });
      expect(currentStatus(off, "live", 10).remedy).toBe("Set the zero in the bring-up.");
    });

    it("states the next step, and the run that is recorded", () => {
      expect(currentStatus(state({ mode: "pretension" }), "live", 10).text).toBe(TEXTS.statusReady);
      expect(currentStatus(state({ recording_run: 7 }), "live", 10).text).toContain(
        fillText(TEXTS.statusRecording, { run: 7 }),
      );
    });
  });

  describe("a replay", () => {
    const player = {
      title: "run 12",
      t: 12,
      tick: 12_000,
      duration_s: 102,
      playing: true,
      ended: false,
      speed: 1,
      speed_min: 0.25,
      speed_max: 4,
    };

    it("is shown with its title, its position, and its state", () => {
      const statusOf = (part: object) =>
        currentStatus(
          state({ mode: "off", unready: "nothing starts", player: { ...player, ...part } }),
          "live",
          10,
        );
      expect(statusOf({})).toMatchObject({
        tone: "busy",
        text: "Replay of run 12, 0:12 of 1:42, playing.",
        remedy: "",
      });
      expect(statusOf({ speed: 0.25 }).text).toContain("playing at 0.25×");
      expect(statusOf({ playing: false })).toMatchObject({
        tone: "calm",
        text: "Replay of run 12, 0:12 of 1:42, paused.",
      });
      expect(statusOf({ playing: false, t: 102, ended: true }).text).toBe(
        "Replay of run 12, 1:42 of 1:42, ended.",
      );
    });

    it("is paused by STOP, without a proof of zero volts", () => {
      const proof = { ...PROOF, paused_recording: true };
      for (const stop of [{ kind: "idle" }, { kind: "confirmed", proof }] as const) {
        const sentence = stopSentence(stop, { mode: "off", stop_proof: proof });
        expect(sentence).toContain("Playback paused");
        expect(sentence).not.toMatch(/volts|ms/);
      }
    });
  });

  describe("stopSentence", () => {
    it("shows the proof of a stop from another page until the reset", () => {
      expect(stopSentence({ kind: "idle" }, { mode: "tripped", stop_proof: PROOF })).toContain("0.83 ms");
      expect(stopSentence({ kind: "idle" }, { mode: "run", stop_proof: PROOF })).toBe("");
    });

    it("is empty for an unconfirmed stop, which STOP itself shows", () => {
      const stop = { kind: "unconfirmed", reason: "No answer." } as const;
      expect(stopSentence(stop, { mode: "tripped", stop_proof: PROOF })).toBe("");
      expect(describeStop(stop)).toBe("STOP NOT CONFIRMED: use the stop at the machine. No answer.");
    });
  });
});
