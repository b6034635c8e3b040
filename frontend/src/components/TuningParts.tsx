/** Parts of a tuning that several pages show: margins of the motor loop, undo and redo. */

import { Button } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import { fixed } from "../samples/format";
import { fillText } from "../samples/texts";
import { banksQuery } from "../service/api/banks";
import { describeTuning, motorMarginsQuery, type useTuningStep, whyNoStep } from "../service/api/tuning";
import { useWhyNoControl } from "../service/control/control";
import type { MotorMargins as Margins } from "../wire/types";
import { Explained } from "./Explained";
import { TEXTS } from "./texts";

/** Text of the margins of the motor loop. Pure. */

/** If a lower gain makes the loop unstable, the text contains both limits of the gain. */
export function marginsText({ M_s, gain_margin, gain_reduction_margin, phase_margin_deg }: Margins): string {
  const up =
    gain_margin === null
      ? TEXTS.unlimited
      : fillText(TEXTS.gainMargin, {
          up: fixed(gain_margin, 1),
          dB: fixed(20 * Math.log10(gain_margin), 1),
        });
  const gain =
    gain_reduction_margin === null
      ? up
      : fillText(TEXTS.gainMarginBothWays, { down: fixed(gain_reduction_margin, 3), up });
  const phase = phase_margin_deg === null ? TEXTS.unlimited : `${fixed(phase_margin_deg, 0)}°`;
  return fillText(TEXTS.margins, { peak: fixed(M_s, 3), gain, phase });
}

/** Robustness of the motor loops at a λ_motor, which the service computes from the sampled loop with L/R. */

interface MotorMarginsProps {
  readonly lam_motor: number;
  /** Active bank; null for geometric gains. */
  readonly bank: number | null;
  readonly className?: string | undefined;
}

export function MotorMargins({ lam_motor, bank, className }: MotorMarginsProps) {
  const { data, error } = useQuery(motorMarginsQuery(lam_motor, bank));
  const words = error?.message ?? (data === undefined ? "…" : marginsText(data));
  return (
    <output className={className} aria-label={TEXTS.motorLoop}>
      {TEXTS.motorLoopAt} <Explained of="quantity:lam_motor">λ_motor</Explained>{" "}
      {fillText(TEXTS.motorLoopMargins, { lambda: lam_motor, margins: words })}
    </output>
  );
}

/** Undo and redo of changes to the active tuning. */

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
  const noControl = useWhyNoControl();
  const reason = useLive((live) => whyNoStep(step, live.state, noControl));
  const { data: banks = [] } = useQuery(banksQuery);
  const words = tuning === null ? "" : describeTuning({ ...tuning, bank: tuning.bank?.id ?? 0 }, banks);
  return (
    <Button
      variant="default"
      {...(size === undefined ? {} : { size })}
      disabled={reason !== null}
      loading={command.isPending}
      title={reason ?? fillText(isUndo ? TEXTS.undoTo : TEXTS.redoTo, { tuning: words })}
      onClick={() => command.mutate()}
    >
      {isUndo ? TEXTS.undoChange : TEXTS.redoChange}
    </Button>
  );
}
