/** Queue of experiments. */

import { ActionIcon, Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { TbArrowUp, TbX } from "react-icons/tb";
import { Card } from "../../components/Card";
import { OperatorsOnly } from "../../components/ControlMenu";
import { Refusal } from "../../components/Refusal";
import { useLive } from "../../live/react";
import { fillText } from "../../samples/texts";
import { queueQuery, useQueueCommand } from "../../service/api/experiments";
import { useWhyNoControl } from "../../service/control/control";
import type { ExperimentKind } from "../../wire/types";
import { NextMode } from "../operate/ModeCard";
import { whyNoStart } from "../operate/ReferencesCard";
import page from "../Page.module.css";
import { RunSummary, tuningOf } from "./ExperimentForm";
import { TEXTS } from "./texts";

export function QueueCard({ kinds }: { kinds: readonly ExperimentKind[] }) {
  const { data: queue } = useQuery(queueQuery);
  const command = useQueueCommand();
  const noControl = useWhyNoControl();
  const state = useLive((live) => live.state);
  const items = queue?.items ?? [];
  const reason = whyNoStart(state, "experiment", noControl);
  const startable = items.length > 0 && reason === null;
  const title = (name: string) => kinds.find((kind) => kind.name === name)?.title ?? name;
  return (
    <Card
      title={TEXTS.queue}
      aside={<span className={page.dim}>{queue?.running ? TEXTS.queueRunning : TEXTS.queueIdle}</span>}
    >
      <div className={page.fields}>
        {items.length === 0 && <span className={page.dim}>{TEXTS.queueEmpty}</span>}
        {items.length > 0 && (
          <ol aria-label={TEXTS.queue} style={{ margin: 0, paddingLeft: 20 }}>
            {items.map((item, place) => (
              <li key={item.id}>
                <div className={page.actions} style={{ justifyContent: "space-between", flexWrap: "nowrap" }}>
                  <span>
                    {title(item.name)}{" "}
                    <span className={page.dim}>
                      {fillText(item.kept ? TEXTS.queuedBeforeRestart : TEXTS.queuedBy, { person: item.who })}
                    </span>
                    <br />
                    <RunSummary name={item.name} settings={item.settings} active={tuningOf(state)} />
                  </span>
                  <OperatorsOnly>
                    <ActionIcon
                      variant="subtle"
                      color="gray"
                      disabled={place === 0}
                      aria-label={fillText(TEXTS.moveUpInQueue, { id: item.id })}
                      onClick={() => command.mutate({ do: "move", id: item.id, place: place - 1 })}
                    >
                      <TbArrowUp size={14} />
                    </ActionIcon>
                    <ActionIcon
                      variant="subtle"
                      color="gray"
                      aria-label={fillText(TEXTS.removeFromQueue, { id: item.id })}
                      onClick={() => command.mutate({ do: "remove", id: item.id })}
                    >
                      <TbX size={14} />
                    </ActionIcon>
                  </OperatorsOnly>
                </div>
              </li>
            ))}
          </ol>
        )}
        <OperatorsOnly>
          <div className={page.actions}>
            {queue?.running ? (
              <Button
                variant="default"
                title={TEXTS.pauseQueueHint}
                onClick={() => command.mutate({ do: "hold" })}
              >
                {TEXTS.pauseQueue}
              </Button>
            ) : (
              <Button
                variant="default"
                disabled={!startable}
                title={reason ?? ""}
                loading={command.isPending}
                onClick={() => command.mutate({ do: "run" })}
              >
                {queue?.problem ? TEXTS.startQueueAgain : TEXTS.startQueue}
              </Button>
            )}
          </div>
        </OperatorsOnly>
        <Refusal
          error={command.error}
          about={queue}
          text={
            queue?.problem ? queue.problem : items.length > 0 ? (queue?.running ? noControl : reason) : null
          }
        >
          {!queue?.problem && <NextMode need="start" />}
        </Refusal>
      </div>
    </Card>
  );
}
