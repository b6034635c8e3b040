import { Button, Progress } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect, useSyncExternalStore } from "react";
import { TbAlertTriangle, TbCircleX, TbInfoCircle, TbPlayerPlay } from "react-icons/tb";
import { Link } from "wouter";
import { age_ms, type Health, health } from "../live/link";
import { useLive, useNow } from "../live/react";
import { age, capital, clockTime, duration, fixed, spacedName } from "../samples/format";
import { localizeText } from "../samples/quantity";
import { countThings, fillText } from "../samples/texts";
import { useReset } from "../service/api/actuator";
import { useAngleUnit } from "../service/api/preferences";
import { flightOf, flightsQuery } from "../service/api/recordings";
import { useMayCommand, useWhyNoControl } from "../service/control/control";
import type { ControlForm } from "../service/control/handover";
import { isAboutControl, useErrorLifetime } from "../service/forms/refusals";
import {
  describeProof,
  describeStop,
  observeState,
  registerDisplay,
  type StopState,
  stopState,
  subscribeToStop,
} from "../stop/stop";
import type { PlayerPosition, State, Task } from "../wire/types";
import { HandOver } from "./ControlMenu";
import { Explained } from "./Explained";
import { TakeControl } from "./Refusal";
import statusStripStyles from "./StatusStrip.module.css";
import { TEXTS } from "./texts";

/** Status line: the most important message, control, and the result of STOP. */

/** Result of the last press of STOP, which works without the application. */

function useStop(): StopState {
  return useSyncExternalStore(subscribeToStop, stopState);
}

/** The most important message at the moment. Pure. */

type Tone = "calm" | "busy" | "warn" | "fault";

interface Status {
  readonly tone: Tone;
  readonly text: string;
  readonly remedy: string;
  readonly task: Task | null;
  readonly resettable: boolean;
}

const HINTS: Record<State["mode"], string> = {
  off: TEXTS.statusOff,
  pretension: TEXTS.statusPretension,
  run: TEXTS.statusRun,
  compliance: TEXTS.statusCompliance,
  identify: TEXTS.statusIdentify,
  experiment: TEXTS.statusExperiment,
  stopping: TEXTS.statusStopping,
  tripped: TEXTS.statusTripped,
};

/** Modes in which the loss of the page in control causes a soft stop. */
const MOVABLE: ReadonlySet<State["mode"]> = new Set([
  "pretension",
  "run",
  "compliance",
  "identify",
  "experiment",
]);

/** Next step of a person who may send commands. */
const NEXT: Partial<Record<State["mode"], string>> = { off: TEXTS.nextOff };

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
    return sentence(
      "warn",
      age_ms === null ? TEXTS.statusDown : fillText(TEXTS.statusDownFor, { age: age(age_ms) }),
    );
  }
  if (health === "stale") {
    return sentence(
      "warn",
      age_ms === null ? TEXTS.statusStale : fillText(TEXTS.statusStaleFor, { age: age(age_ms) }),
    );
  }
  if (state === null || !isStateCurrent) return sentence("calm", TEXTS.statusWaiting);
  const { restarting, restarting_s } = state.link;
  if (restarting) {
    return sentence(
      "busy",
      restarting_s == null
        ? fillText(TEXTS.statusRestarting, { why: restarting })
        : fillText(TEXTS.statusRestartingFor, { why: restarting, time: duration(restarting_s) }),
    );
  }
  if (!state.link.alive) {
    return sentence("fault", TEXTS.statusNoLoop, {
      remedy: TEXTS.remedyNoLoop,
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
    return sentence("warn", fillText(TEXTS.statusHolderLost, { name: state.holder.name }), {
      remedy: TEXTS.remedyHolderLost,
    });
  }
  if (state.mode === "compliance" && state.touch.felt) {
    const { F_ext_hat } = state.touch.felt;
    return sentence("warn", fillText(TEXTS.statusContact, { force: fixed(Math.abs(F_ext_hat), 1) }), {
      remedy: mayCommand ? TEXTS.remedyContact : "",
    });
  }
  if (state.mode === "identify" && state.task === null) return sentence("busy", TEXTS.statusBringUp);
  if (state.mode === "pretension" && state.pretension_done) {
    return sentence("calm", TEXTS.statusReady);
  }
  const recording =
    state.recording_run === null ? "" : ` ${fillText(TEXTS.statusRecording, { run: state.recording_run })}`;
  const missing =
    state.mode === "off" && state.unready !== ""
      ? fillText(TEXTS.remedyUnready, { reason: capital(state.unready) })
      : undefined;
  return sentence("calm", HINTS[state.mode] + recording, {
    remedy: (mayCommand && (missing ?? NEXT[state.mode])) || "",
  });
}

/** State of a replay: "Replay of run 12, 0:12 of 1:42, playing at 2×." */
function playerSentence({ title, t, duration_s, playing, ended, speed }: PlayerPosition): string {
  const pace = speed === 1 ? TEXTS.playing : fillText(TEXTS.playingAt, { speed });
  const doing = playing ? pace : ended ? TEXTS.ended : TEXTS.paused;
  return fillText(TEXTS.statusReplay, {
    title,
    at: clockTime(t, 1),
    length: clockTime(duration_s, 1),
    state: doing,
  });
}

function taskName(task: Task): string {
  return fillText(TEXTS.taskDoing, { task: taskTitle(task), part: partOf(task) });
}

/**
 * Title of a run, with its number among the runs of one request: "Motor identification, run 12, 2 of 4". Operating
 * points count over all runs, so their part contains the number. The evaluation covers all runs together.
 */
export function taskTitle({ kind, title, run, number, following, part, phase }: Task): string {
  const several = (following > 0 || number > 1) && part?.doing == null && phase !== "evaluation";
  const named = { title: title || capital(spacedName(kind)), run };
  return several
    ? fillText(TEXTS.taskTitleOfSeveral, { ...named, number, total: number + following })
    : fillText(TEXTS.taskTitle, named);
}

/** Current activity: "part 2 of 3, Breaths, 12 s left", "2 of 4: 20 N, exciting, 12 s left", or "pretension". */
export function partOf({ phase, part }: Task): string {
  if (part === null) return spacedName(phase);
  if (part.doing != null) {
    return fillText(TEXTS.partDoing, {
      number: part.number,
      total: part.of,
      title: part.title,
      activity: part.doing,
      left: duration(part.left_s),
    });
  }
  if (part.of <= 1) return part.title;
  return fillText(TEXTS.partOfSeveral, {
    number: part.number,
    total: part.of,
    title: part.title,
    left: duration(part.left_s),
  });
}

/** Expected remaining time of the run, and the number of runs that follow. */
export function timeLeft({ phase, elapsed_s, duration_s, following }: Task): string {
  if (phase === "evaluation") return TEXTS.computing;
  const left_s = duration_s - elapsed_s;
  const runs = countThings(following, "more run");
  if (left_s < 0) {
    const time = duration(-left_s);
    return following === 0 ? fillText(TEXTS.overdue, { time }) : fillText(TEXTS.overdueThen, { time, runs });
  }
  const times = { left: duration(left_s), total: duration(duration_s) };
  return following === 0 ? fillText(TEXTS.timeLeft, times) : fillText(TEXTS.timeLeftThen, { ...times, runs });
}

/** Completed share of a task, 0 to 1. */
export function taskProgress(task: Task): number {
  return task.duration_s > 0 ? Math.min(1, task.elapsed_s / task.duration_s) : 0;
}

/**
 * Text of the last STOP; the service reports a confirmed one, wherever it was sent. STOP itself shows an unconfirmed
 * one, in a place with enough space.
 */
export function stopSentence(stop: StopState, state: Pick<State, "mode" | "stop_proof"> | null): string {
  if (stop.kind === "unconfirmed") return "";
  if (stop.kind !== "idle") return describeStop(stop);
  if (state?.stop_proof?.paused_recording) return describeProof(state.stop_proof);
  return state?.mode === "tripped" && state.stop_proof !== null ? describeProof(state.stop_proof) : "";
}

/** Result of STOP: the response to the press, until the service reports the stop. */

export function StopResult() {
  const state = useLive((live) => live.state);
  const stop = useStop();
  useEffect(() => registerDisplay(), []);
  useEffect(() => {
    if (state !== null) observeState(state);
  }, [state]);
  return (
    <output className={statusStripStyles.proof} aria-label={TEXTS.stopResult} data-kind={stop.kind}>
      {stopSentence(stop, state)}
    </output>
  );
}

/** Line below the header that is always present, so that a new message does not move the page. */

const ICONS: Record<Tone, typeof TbInfoCircle> = {
  calm: TbInfoCircle,
  busy: TbPlayerPlay,
  warn: TbAlertTriangle,
  fault: TbCircleX,
};

interface StatusStripProps {
  /** Form of the handover that is open; null for none. */
  readonly form: ControlForm | null;
  onForm(form: ControlForm | null): void;
}

export function StatusStrip({ form, onForm }: StatusStripProps) {
  const state = useLive((live) => live.state);
  const link = useLive((live) => live.link);
  const isStateCurrent = useLive((live) => live.isStateCurrent);
  const now_ms = useNow(500);
  const reset = useReset();
  const mayCommand = useMayCommand();
  const refused = useErrorLifetime(reset.error);
  const noControl = useWhyNoControl();
  const status = currentStatus(
    state,
    health(link, now_ms),
    age_ms(link, now_ms),
    mayCommand !== false,
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
            {TEXTS.events}
          </Link>
        </>
      )}
      {status.task !== null && <TaskProgress task={status.task} />}
      {status.resettable && mayCommand !== false && (noControl !== null || isAboutControl(refused)) && (
        <TakeControl />
      )}
      {status.resettable && mayCommand !== false && (
        <Button
          size="compact-xs"
          variant="white"
          color="dark"
          disabled={noControl !== null}
          title={noControl ?? undefined}
          loading={reset.isPending}
          onClick={() => reset.mutate()}
        >
          {TEXTS.reset}
        </Button>
      )}
      <StopResult />
    </div>
  );
}

/** Link to the flight record of a trip, once it is stored. */
function FlightLink() {
  const fault = useLive((live) => live.state?.fault ?? null);
  const { data = [] } = useQuery({ ...flightsQuery, refetchInterval: 1000 });
  const flight = flightOf(data, fault);
  if (flight === undefined) return null;
  return (
    <Link href={`/flights/${flight.id}`} className={statusStripStyles.more}>
      {TEXTS.flightRecord}
    </Link>
  );
}

function Message({ status, instead }: { status: Status; instead: string | undefined }) {
  const angles = useAngleUnit();
  const fault = useLive((live) => live.state?.fault ?? null);
  const localized = (text: string) => localizeText(text, angles);
  const content = (
    <>
      <strong>
        <Explained of={status.text === fault?.message ? `fault:${fault.code}` : undefined}>
          {localized(status.text)}
        </Explained>
      </strong>{" "}
      {localized(instead ?? status.remedy)}
    </>
  );
  const title = localized(`${status.text} ${status.remedy}`);
  if (status.tone === "fault") {
    return (
      <div role="alert" aria-label={TEXTS.fault} className={statusStripStyles.message}>
        {content}
      </div>
    );
  }
  return (
    <output aria-label={TEXTS.status} className={statusStripStyles.message} title={title}>
      {content}
    </output>
  );
}

function TaskProgress({ task }: { task: Task }) {
  const percent = 100 * taskProgress(task);
  return (
    <span className={statusStripStyles.task}>
      <Progress.Root size={6} w={160}>
        <Progress.Section value={percent} aria-label={TEXTS.taskProgress} />
      </Progress.Root>
      <span>
        {fillText(TEXTS.taskTime, {
          elapsed: duration(task.elapsed_s),
          total: duration(task.duration_s),
        })}
      </span>
    </span>
  );
}
