/** A line under the header that is always there, so that nothing moves when it has something to say. */

import { Button, Progress } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { TbAlertTriangle, TbCircleX, TbInfoCircle, TbPlayerPlay } from "react-icons/tb";
import { Link } from "wouter";
import { age_ms, health } from "../live/link";
import { useLive, useNow } from "../live/react";
import { duration } from "../samples/format";
import { inWords } from "../samples/quantity";
import { useAngles } from "../service/angles";
import { useReset } from "../service/commands";
import type { ControlForm } from "../service/handOver";
import { isAboutControl } from "../service/standing";
import { flightOf, flightsQuery } from "../service/system";
import { useErrorLifetime } from "../service/useErrorLifetime";
import { useMayCommand } from "../service/useMayCommand";
import { useNoControl } from "../service/useNoControl";
import type { Task } from "../wire/types";
import { Explained } from "./Explained";
import { HandOver } from "./HandOver";
import styles from "./StatusStrip.module.css";
import { StopResult } from "./StopResult";
import { currentStatus, type Status, type Tone, taskProgress } from "./status";
import { TakeControl } from "./TakeControl";

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
  const noControl = useNoControl();
  const status = currentStatus(
    state,
    health(link, now_ms),
    age_ms(link, now_ms),
    may !== false,
    isStateCurrent,
  );
  const Icon = ICONS[status.tone];
  return (
    <div className={styles.strip} data-tone={status.tone}>
      <Icon size={18} aria-hidden="true" className={styles.icon} />
      <Message status={status} instead={status.resettable ? refused?.message : undefined} />
      <HandOver form={form} onForm={onForm} />
      {status.tone === "fault" && (
        <>
          <FlightLink />
          <Link href="/log" className={styles.more}>
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
    <Link href={`/flights/${flight.id}`} className={styles.more}>
      Flight record
    </Link>
  );
}

function Message({ status, instead }: { status: Status; instead: string | undefined }) {
  const angles = useAngles();
  const fault = useLive((live) => live.state?.fault ?? null);
  const told = (text: string) => inWords(text, angles);
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
      <div role="alert" aria-label="Fault" className={styles.message}>
        {content}
      </div>
    );
  }
  return (
    <output aria-label="Status" className={styles.message} title={title}>
      {content}
    </output>
  );
}

function TaskProgress({ task }: { task: Task }) {
  const percent = 100 * taskProgress(task);
  return (
    <span className={styles.task}>
      <Progress.Root size={6} w={160}>
        <Progress.Section value={percent} aria-label="Task progress" />
      </Progress.Root>
      <span>
        {duration(task.elapsed_s)} of {duration(task.duration_s)}
      </span>
    </span>
  );
}
