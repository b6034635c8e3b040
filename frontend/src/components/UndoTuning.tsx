/** Steps back and forward through what was in force, whatever part of it was changed. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import type { useTuningStep } from "../service/commands";
import { useNoControl } from "../service/control";
import { banksQuery } from "../service/queries";
import { tuningInWords, whyNoStep } from "../service/tuning";

type TuningStep = ReturnType<typeof useTuningStep>;

interface UndoTuningProps {
  readonly undo: TuningStep;
  readonly redo: TuningStep;
  readonly size?: "compact-xs";
}

export function UndoTuning({ undo, redo, size }: UndoTuningProps) {
  return (
    <>
      <StepButton step="undo" command={undo} {...(size === undefined ? {} : { size })} />
      <StepButton step="redo" command={redo} {...(size === undefined ? {} : { size })} />
    </>
  );
}

interface StepButtonProps {
  readonly step: "undo" | "redo";
  readonly command: TuningStep;
  readonly size?: "compact-xs";
}

function StepButton({ step, command, size }: StepButtonProps) {
  const isUndo = step === "undo";
  const tuning = useLive((live) => (isUndo ? live.state?.earlier : live.state?.later) ?? null);
  const noControl = useNoControl();
  const reason = useLive((live) => whyNoStep(step, live.state, noControl));
  const { data: banks = [] } = useQuery(banksQuery);
  const words = tuning === null ? "" : tuningInWords({ ...tuning, bank: tuning.bank?.id ?? 0 }, banks);
  return (
    <Button
      variant="default"
      {...(size === undefined ? {} : { size })}
      disabled={reason !== null}
      loading={command.isPending}
      title={reason ?? `${isUndo ? "Back to" : "Again"} ${words}`}
      onClick={() => command.mutate()}
    >
      {isUndo ? "Undo change" : "Redo change"}
    </Button>
  );
}
