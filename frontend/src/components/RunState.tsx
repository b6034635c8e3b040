import type { ReactNode } from "react";
import type { IconType } from "react-icons";
import {
  TbAlertTriangle,
  TbCheck,
  TbHandStop,
  TbPlayerRecord,
  TbPlugConnectedX,
  TbSkull,
  TbUrgent,
} from "react-icons/tb";
import { heading } from "../samples/format";
import { localizeText } from "../samples/quantity";
import { fillText } from "../samples/texts";
import { useAngleUnit } from "../service/api/preferences";
import { entryOf } from "../service/glossary";
import type { Experiment, Run } from "../wire/types";
import { Explained, type Meaning } from "./Explained";
import runStateStyles from "./RunState.module.css";
import { TEXTS } from "./texts";
import verdictStyles from "./Verdict.module.css";
import { LocalizedText } from "./values";

/** State of a run with text and icon. */

const STATES: Record<string, { Icon: IconType; abnormal: boolean }> = {
  running: { Icon: TbPlayerRecord, abnormal: false },
  completed: { Icon: TbCheck, abnormal: false },
  stopped: { Icon: TbHandStop, abnormal: false },
  tripped: { Icon: TbUrgent, abnormal: true },
  link_lost: { Icon: TbPlugConnectedX, abnormal: true },
  service_died: { Icon: TbSkull, abnormal: true },
};

/** `unevaluated`: reason why a run has no result; undefined if it has one or needs none. */
export function RunState({
  state,
  reason = "",
  unevaluated,
}: {
  state: string;
  reason?: string;
  unevaluated?: string | undefined;
}) {
  const angles = useAngleUnit();
  const known = STATES[state];
  const lacksResult = unevaluated !== undefined;
  const of = entryOf(`end:${state}`);
  const why = [reason, unevaluated ?? ""].filter((text) => text !== "").join("; ");
  const Icon = lacksResult ? TbUrgent : (known?.Icon ?? TbUrgent);
  return (
    <span
      className={runStateStyles.state}
      data-abnormal={lacksResult || (known?.abnormal ?? true)}
      data-state={state}
    >
      <Icon size={15} aria-hidden="true" />
      <Explained
        of={of && { ...of, more: why === "" ? [] : [[TEXTS.runReason, localizeText(why, angles)]] }}
        quiet
      >
        {lacksResult ? fillText(TEXTS.runNotEvaluated, { state: heading(state) }) : heading(state)}
      </Explained>
    </span>
  );
}

/** Reason why a run has no result, for `RunState`. */
export function unevaluated(run: Run): string | undefined {
  if (run.evaluation !== "missing") return undefined;
  return run.evaluation_problem === "" ? TEXTS.notEvaluatedInTime : run.evaluation_problem;
}

/** Verdict with icon and text, never by colour alone. */

interface VerdictProps {
  readonly good: boolean;
  /** Glossary entry of the criterion. */
  readonly of?: Meaning;
  readonly children: ReactNode;
}

export function Verdict({ good, of, children }: VerdictProps) {
  const Icon = good ? TbCheck : TbAlertTriangle;
  return (
    <span className={verdictStyles.verdict} data-good={good}>
      <Icon size={16} aria-hidden="true" />
      <span>
        <Explained of={of} quiet>
          {typeof children === "string" ? <LocalizedText text={children} /> : children}
        </Explained>
      </span>
    </span>
  );
}

/** Outcome of a run in the sentence of its report; only a passed run has the mark of a pass. */
export function Outcome({ of: { outcome, verdict } }: { of: Pick<Experiment, "outcome" | "verdict"> }) {
  const of = `outcome:${outcome}`;
  if (outcome === "neutral") {
    return (
      <Explained of={of} quiet>
        {verdict}
      </Explained>
    );
  }
  return (
    <Verdict good={outcome === "passed"} of={of}>
      {verdict}
    </Verdict>
  );
}
