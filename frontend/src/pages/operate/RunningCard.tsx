/** What runs now, on the page that it was started from: in words, with the time left, a soft way out, and live curves. */

import { Button, Progress } from "@mantine/core";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/OperatorsOnly";
import { Refusal } from "../../components/Refusal";
import { partOf, taskProgress, taskTitle, timeLeft } from "../../components/status";
import { useLive } from "../../live/react";
import { useSetMode } from "../../service/commands";
import type { Task } from "../../wire/types";
import page from "../Page.module.css";
import { LiveCharts } from "./LiveCharts";
import { whyNot } from "./ModeCard";
import { PlannedProfile } from "./PlannedProfile";

export function RunningCard() {
  const task = useLive((live) => live.state?.task ?? null);
  return task === null ? null : <Running task={task} />;
}

function Running({ task }: { task: Task }) {
  const state = useLive((live) => live.state);
  const setMode = useSetMode();
  const reason = whyNot(state, "stopping");
  return (
    <Card title="Running now" aside={<output aria-label="Time left">{timeLeft(task)}</output>}>
      <div className={page.fields}>
        <div className={page.actions} style={{ justifyContent: "space-between" }}>
          <output aria-label="What runs now">
            <strong>{taskTitle(task)}</strong>: {partOf(task)}
          </output>
          <OperatorsOnly>
            <Button
              variant="default"
              aria-disabled={reason !== null}
              data-disabled={reason !== null ? true : undefined}
              title={
                reason ?? "Soft stop: bring the joint to rest under tension. The run is kept as stopped."
              }
              loading={setMode.isPending}
              onClick={() => reason === null && setMode.mutate("stopping")}
            >
              Abort softly
            </Button>
          </OperatorsOnly>
        </div>
        <Progress.Root size={6}>
          <Progress.Section value={100 * taskProgress(task)} aria-label="Progress of what runs now" />
        </Progress.Root>
        {task.part !== null && <PlannedProfile run={task.run} at_s={task.part.t} />}
        <Refusal error={setMode.error} about={task.run} />
      </div>
      <div className={page.charts} style={{ marginTop: 12 }}>
        <LiveCharts />
      </div>
    </Card>
  );
}
