import { Button, Progress } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useSyncExternalStore } from "react";
import { TbAlertTriangle, TbCircleX, TbInfoCircle, TbPlayerPlay } from "react-icons/tb";
import { Link } from "wouter";
import { age_ms, type Health, health } from "../live/link";
import { useLive, useNow } from "../live/react";
import { age, capital, clockTime, duration, fixed, pluralized, spacedName } from "../samples/format";
import { localizeText } from "../samples/quantity";
import { useReset } from "../service/api/actuator";
import { useAngleUnit } from "../service/api/preferences";
import { flightOf, flightsQuery } from "../service/api/recordings";
import { useMayCommand, useWhyNoControl } from "../service/control/control";
import type { ControlForm } from "../service/control/handover";
import { isAboutControl, useErrorLifetime } from "../service/forms/refusals";
import {
  describeProof,
  describeStop,
  listenToStop,
  observeState,
  type StopState,
  showElsewhere,
  stopState,
} from "../stop/stop";
import type { PlayerPosition, State, Task } from "../wire/types";
import { HandOver } from "./ControlMenu";
import { Explained } from "./Explained";
import { TakeControl } from "./Refusal";
import statusStripStyles from "./StatusStrip.module.css";

/** Commands to the actuator: mode, references, pushes, contact, wall; and what became of STOP. */

/** What became of the last press of STOP, which works without the application. */

function useStop(): StopState {
  return useSyncExternalStore(listenToStop, stopState);
}

/** The one sentence that matters most right now. Pure. */

type Tone = "calm" | "busy" | "warn" | "fault";

interface Status {
  readonly tone: Tone;
  readonly text: string;
  readonly remedy: string;
  readonly task: Task | null;
  readonly resettable: boolean;
}

const HINTS: Record<State["mode"], string> = {
  off: "Motors off.",
  pretension: "Winding up the tendons to pretension.",
  run: "Loops closed.",
  compliance: "Compliance: joint loop open, q_ref acts through geometry alone; stiffness loop closed.",
  identify: "Identification is running.",
  experiment: "Experiment is running.",
  stopping: "Soft stop: bringing the joint to rest under tension.",
  tripped: "Stopped and latched.",
};

/** Modes in which the loss of the page that holds control ends in a soft stop. */
const MOVABLE: ReadonlySet<State["mode"]> = new Set([
  "pretension",
  "run",
  "compliance",
  "identify",
  "experiment",
]);

/** What whoever may command does next. */
const NEXT: Partial<Record<State["mode"], string>> = { off: "Start Pretension to wind the tendons up." };

function sentence(tone: Tone, text: string, more: Partial<Status> = {}): Status {
  return { tone, text, remedy: "", task: null, resettable: false, ...more };
}

export function currentStatus(
  state: State | null,
  health: Health,
  age_ms: number | null,
  mayCommand = true,
  isStateCurrent = true,
): Status {
  if (health === "down") {
    const since = age_ms === null ? "" : ` for ${age(age_ms)}`;
    return sentence("warn", `No connection to the service${since}. Values shown are old; trying again.`);
  }
  if (health === "stale") {
    const since = age_ms === null ? "" : ` for ${age(age_ms)}`;
    return sentence("warn", `Nothing heard from the service${since}. Values are old.`);
  }
  if (state === null || !isStateCurrent)
    return sentence("calm", "Connected. Waiting for the state of the loop.");
  const { restarting, restarting_s } = state.link;
  if (restarting) {
    const since = restarting_s == null ? "" : `, ${duration(restarting_s)}`;
    return sentence("busy", `Restarting the control loop ${restarting}${since}.`);
  }
  if (!state.link.alive) {
    return sentence("fault", "The loop process is not running.", {
      remedy: "Press Reset to start a new one.",
      resettable: true,
    });
  }
  if (state.fault !== null) {
    const { message, remedy, expected } = state.fault;
    if (expected) return sentence("calm", message, { remedy, resettable: remedy !== "" });
    return sentence("fault", message, { remedy, resettable: true });
  }
  if (state.problems.length > 0) return sentence("warn", state.problems.join(" "), { task: state.task });
  if (state.player) return sentence(state.player.playing ? "busy" : "calm", playerSentence(state.player));
  if (state.task !== null) return sentence("busy", taskName(state.task), { task: state.task });
  if (state.holder?.lost && MOVABLE.has(state.mode)) {
    return sentence("warn", `The page of ${state.holder.name}, who holds control, is not heard.`, {
      remedy: "The references are held; a soft stop follows unless the page comes back.",
    });
  }
  if (state.mode === "compliance" && state.touch.felt) {
    const { F_ext_hat } = state.touch.felt;
    return sentence("warn", `Contact of ${fixed(Math.abs(F_ext_hat), 1)} N: the joint gives way.`, {
      remedy: mayCommand ? "Choose a mode to go on." : "",
    });
  }
  if (state.mode === "identify" && state.task === null)
    return sentence("busy", "A step of the bring-up is running.");
  if (state.mode === "pretension" && state.pretension_done) {
    return sentence("calm", "Pretension held in both tendons. Ready to run.");
  }
  const recording = state.recording_run === null ? "" : ` Recording run ${state.recording_run}.`;
  const missing = state.mode === "off" && state.unready !== "" ? `${capital(state.unready)}.` : undefined;
  return sentence("calm", HINTS[state.mode] + recording, {
    remedy: (mayCommand && (missing ?? NEXT[state.mode])) || "",
  });
}

/** What is played, how far it is, and whether it goes on: "Replay of run 12, 0:12 of 1:42, playing at 2×." */
function playerSentence({ title, t, duration_s, playing, ended, speed }: PlayerPosition): string {
  const pace = speed === 1 ? "playing" : `playing at ${speed}×`;
  const doing = playing ? pace : ended ? "ended" : "paused";
  return `Replay of ${title}, ${clockTime(t, 1)} of ${clockTime(duration_s, 1)}, ${doing}.`;
}

function taskName(task: Task): string {
  return `${taskTitle(task)}: ${partOf(task)}`;
}

/**
 * Which run it is, of an order of several too: "Motor identification, run 12, 2 of 4". Set points are counted over all
 * runs of their order, and tell it by themselves. Results are computed of all runs together, and none follows any more.
 */
export function taskTitle({ kind, title, run, number, following, part, phase }: Task): string {
  const several = (following > 0 || number > 1) && part?.doing == null && phase !== "evaluation";
  return `${title || capital(spacedName(kind))}, run ${run}${several ? `, ${number} of ${number + following}` : ""}`;
}

/** What is being done for it: "part 2 of 3, Breaths, 12 s left", "2 of 4: 20 N, exciting, 12 s left", or "pretension". */
export function partOf({ phase, part }: Task): string {
  if (part === null) return spacedName(phase);
  if (part.doing !== null) {
    return `${part.number} of ${part.of}: ${part.title}, ${part.doing}, ${duration(part.left_s)} left`;
  }
  const place = part.of > 1 ? `part ${part.number} of ${part.of}, ` : "";
  return `${place}${part.title}${part.of > 1 ? `, ${duration(part.left_s)} left` : ""}`;
}

/** Of the whole run, as it is expected now, and how many of its order follow it. */
export function timeLeft({ phase, elapsed_s, duration_s, following }: Task): string {
  if (phase === "evaluation") return "computing the result";
  const left_s = duration_s - elapsed_s;
  const more = following === 0 ? "" : `, then ${pluralized(following, "more run")}`;
  return left_s >= 0
    ? `${duration(left_s)} left of ${duration(duration_s)}${more}`
    : `${duration(-left_s)} longer than expected${more}`;
}

/** Part of a task that is done, 0 to 1. */
export function taskProgress(task: Task): number {
  return task.duration_s > 0 ? Math.min(1, task.elapsed_s / task.duration_s) : 0;
}

/**
 * What became of the last STOP, in words; a stop that took place is told by the service, from wherever it came. STOP
 * itself says that it was not confirmed, in a place that nothing narrows.
 */
export function stopSentence(stop: StopState, state: Pick<State, "mode" | "stop_proof"> | null): string {
  if (stop.kind === "unconfirmed") return "";
  if (stop.kind !== "idle") return describeStop(stop);
  if (state?.stop_proof?.paused_recording) return describeProof(state.stop_proof);
  return state?.mode === "tripped" && state.stop_proof !== null ? describeProof(state.stop_proof) : "";
}

/** What became of STOP: from the answer to the press until the service tells it itself, and then as the service tells it. */

export function StopResult() {
  const state = useLive((live) => live.state);
  const stop = useStop();
  useEffect(() => showElsewhere(), []);
  useEffect(() => {
    if (state !== null) observeState(state);
  }, [state]);
  return (
    <output className={statusStripStyles.proof} aria-label="Stop result" data-kind={stop.kind}>
      {stopSentence(stop, state)}
    </output>
  );
}

/** A line under the header that is always there, so that nothing moves when it has something to say. */

const ICONS: Record<Tone, typeof TbInfoCircle> = {
  calm: TbInfoCircle,
  busy: TbPlayerPlay,
  warn: TbAlertTriangle,
  fault: TbCircleX,
};

interface StatusStripProps {
  /** What the person is about to say of control; null for nothing. */
  readonly form: ControlForm | null;
  onForm(form: ControlForm | null): void;
}

export function StatusStrip({ form, onForm }: StatusStripProps) {
  const state = useLive((live) => live.state);
  const link = useLive((live) => live.link);
  const isStateCurrent = useLive((live) => live.isStateCurrent);
  const now_ms = useNow(500);
  const reset = useReset();
  const may = useMayCommand();
  const refused = useErrorLifetime(reset.error);
  const noControl = useWhyNoControl();
  const status = currentStatus(
    state,
    health(link, now_ms),
    age_ms(link, now_ms),
    may !== false,
    isStateCurrent,
  );
  const Icon = ICONS[status.tone];
  return (
    <div className={statusStripStyles.strip} data-tone={status.tone}>
      <Icon size={18} aria-hidden="true" className={statusStripStyles.icon} />
      <Message status={status} instead={status.resettable ? refused?.message : undefined} />
      <HandOver form={form} onForm={onForm} />
      {status.tone === "fault" && (
        <>
          <FlightLink />
          <Link href="/log" className={statusStripStyles.more}>
            What happened
          </Link>
        </>
      )}
      {status.task !== null && <TaskProgress task={status.task} />}
      {status.resettable && may !== false && (noControl !== null || isAboutControl(refused)) && (
        <TakeControl />
      )}
      {status.resettable && may !== false && (
        <Button
          size="compact-xs"
          variant="white"
          color="dark"
          disabled={noControl !== null}
          title={noControl ?? undefined}
          loading={reset.isPending}
          onClick={() => reset.mutate()}
        >
          Reset
        </Button>
      )}
      <StopResult />
    </div>
  );
}

/** To the seconds around the trip, once they are over and kept. */
function FlightLink() {
  const fault = useLive((live) => live.state?.fault ?? null);
  const { data = [] } = useQuery({ ...flightsQuery, refetchInterval: 1000 });
  const flight = flightOf(data, fault);
  if (flight === undefined) return null;
  return (
    <Link href={`/flights/${flight.id}`} className={statusStripStyles.more}>
      Flight record
    </Link>
  );
}

function Message({ status, instead }: { status: Status; instead: string | undefined }) {
  const angles = useAngleUnit();
  const fault = useLive((live) => live.state?.fault ?? null);
  const told = (text: string) => localizeText(text, angles);
  const content = (
    <>
      <strong>
        <Explained of={status.text === fault?.message ? `fault:${fault.code}` : undefined}>
          {told(status.text)}
        </Explained>
      </strong>{" "}
      {told(instead ?? status.remedy)}
    </>
  );
  const title = told(`${status.text} ${status.remedy}`);
  if (status.tone === "fault") {
    return (
      <div role="alert" aria-label="Fault" className={statusStripStyles.message}>
        {content}
      </div>
    );
  }
  return (
    <output aria-label="Status" className={statusStripStyles.message} title={title}>
      {content}
    </output>
  );
}

function TaskProgress({ task }: { task: Task }) {
  const percent = 100 * taskProgress(task);
  return (
    <span className={statusStripStyles.task}>
      <Progress.Root size={6} w={160}>
        <Progress.Section value={percent} aria-label="Task progress" />
      </Progress.Root>
      <span>
        {duration(task.elapsed_s)} of {duration(task.duration_s)}
      </span>
    </span>
  );
}
