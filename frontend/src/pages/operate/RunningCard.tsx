/** Card of the current run on its start page: title, part, time left, soft abort and live charts. */

import { Button, Progress } from "@mantine/core";
import { useMediaQuery } from "@mantine/hooks";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { partOf, taskProgress, taskTitle, timeLeft } from "../../components/StatusStrip";
import { useLive } from "../../live/react";
import { countThings, fillText } from "../../samples/texts";
import { useSetMode } from "../../service/api/actuator";
import { usePauseOrder } from "../../service/api/identifications";
import { useWhyNoControl } from "../../service/control/control";
import { lastRefusal } from "../../service/forms/refusals";
import type { Task } from "../../wire/types";
import page from "../Page.module.css";
import { LiveCharts } from "./LiveCharts";
import { whyNot } from "./ModeCard";
import { PlannedProfile } from "./StepPreview";
import { TEXTS } from "./texts";

interface PlaceProps {
  /** Above the columns of the page, or in one of them. */
  readonly place: "above" | "beside";
}

/** On a narrow screen the card is above the columns, so that it precedes the form of the run. */
export function RunningCard({ place }: PlaceProps) {
  const task = useLive((live) => live.state?.task ?? null);
  const narrow = useMediaQuery("(max-width: 700px)", false, { getInitialValueInEffect: false });
  return task === null || narrow !== (place === "above") ? null : <Running task={task} />;
}

function Running({ task }: { task: Task }) {
  const setMode = useSetMode();
  const pause = usePauseOrder();
  const noControl = useWhyNoControl();
  return (
    <Card title={TEXTS.running} aside={<output aria-label={TEXTS.timeLeft}>{timeLeft(task)}</output>}>
      <div className={page.fields}>
        <div className={page.actions} style={{ justifyContent: "space-between" }}>
          <output aria-label={TEXTS.currentRun}>
            <strong>{taskTitle(task)}</strong>: {partOf(task)}
          </output>
          <OperatorsOnly>
            <div className={page.actions}>
              {task.following > 0 && <PauseButton task={task} pause={pause} />}
              <AbortButton task={task} setMode={setMode} />
            </div>
          </OperatorsOnly>
        </div>
        <Progress.Root size={6}>
          <Progress.Section value={100 * taskProgress(task)} aria-label={TEXTS.progress} />
        </Progress.Root>
        {task.part !== null && <PlannedProfile run={task.run} at_s={task.part.t} />}
        <Refusal error={lastRefusal(setMode, pause)} about={task.run} text={noControl} />
      </div>
      <div className={page.charts} style={{ marginTop: 12 }}>
        <LiveCharts />
      </div>
    </Card>
  );
}

interface AbortProps {
  readonly task: Task;
  readonly setMode: ReturnType<typeof useSetMode>;
}

function AbortButton({ task, setMode }: AbortProps) {
  const noControl = useWhyNoControl();
  const illegal = useLive((live) => whyNot(live.state, "stopping"));
  const reason = noControl ?? illegal;
  return (
    <Button
      variant="default"
      aria-disabled={reason !== null}
      data-disabled={reason !== null ? true : undefined}
      title={reason ?? fillText(TEXTS.softAbortHint, { result: describeAbort(task) })}
      loading={setMode.isPending}
      onClick={() => reason === null && setMode.mutate("stopping")}
    >
      {TEXTS.softAbort}
    </Button>
  );
}

/** Returns the effect of an abort on the run and on the runs that follow. */
export function describeAbort({ phase, run, following }: Pick<Task, "phase" | "run" | "following">): string {
  return phase === "paused"
    ? fillText(TEXTS.keptAsComplete, { run, runs: countThings(following, TEXTS.remainingRun) })
    : TEXTS.keptAsStopped;
}

interface PauseProps {
  readonly task: Task;
  readonly pause: ReturnType<typeof usePauseOrder>;
}

/** Pauses between two runs of a sequence; within a run the control loop executes the whole program. */
function PauseButton({ task, pause }: PauseProps) {
  const { pause_wanted, phase } = task;
  const noControl = useWhyNoControl();
  const pausedHint = phase === "paused" ? TEXTS.pausedHint : TEXTS.pauseWantedHint;
  return (
    <Button
      variant={pause_wanted ? "light" : "default"}
      aria-pressed={pause_wanted}
      aria-disabled={noControl !== null}
      data-disabled={noControl !== null || undefined}
      title={noControl ?? (pause_wanted ? pausedHint : TEXTS.pauseHint)}
      loading={pause.isPending}
      onClick={() => noControl === null && pause.mutate(!pause_wanted)}
    >
      {pause_wanted ? TEXTS.resume : TEXTS.pauseAfter}
    </Button>
  );
}
