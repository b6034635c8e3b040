/** How a run ended, in words and with an icon. */

import type { IconType } from "react-icons";
import { TbCheck, TbHandStop, TbPlayerRecord, TbPlugConnectedX, TbSkull, TbUrgent } from "react-icons/tb";
import { inWords } from "../samples/quantity";
import { heading } from "../samples/words";
import { useAngles } from "../service/angles";
import { entryOf } from "../service/glossary";
import type { Run } from "../wire/types";
import { Explained } from "./Explained";
import styles from "./RunState.module.css";

const STATES: Record<string, { Icon: IconType; abnormal: boolean }> = {
  running: { Icon: TbPlayerRecord, abnormal: false },
  completed: { Icon: TbCheck, abnormal: false },
  stopped: { Icon: TbHandStop, abnormal: false },
  tripped: { Icon: TbUrgent, abnormal: true },
  link_lost: { Icon: TbPlugConnectedX, abnormal: true },
  service_died: { Icon: TbSkull, abnormal: true },
};

/** `unevaluated` says why a run has no result; undefined where it has one, or is to have none. */
export function RunState({
  state,
  reason = "",
  unevaluated,
}: {
  state: string;
  reason?: string;
  unevaluated?: string | undefined;
}) {
  const angles = useAngles();
  const known = STATES[state];
  const lacksResult = unevaluated !== undefined;
  const of = entryOf(`end:${state}`);
  const why = [reason, unevaluated ?? ""].filter((text) => text !== "").join("; ");
  const Icon = lacksResult ? TbUrgent : (known?.Icon ?? TbUrgent);
  return (
    <span
      className={styles.state}
      data-abnormal={lacksResult || (known?.abnormal ?? true)}
      data-state={state}
    >
      <Icon size={15} aria-hidden="true" />
      <Explained of={of && { ...of, more: why === "" ? [] : [["Here", inWords(why, angles)]] }} quiet>
        {heading(state)}
        {lacksResult && ", not evaluated"}
      </Explained>
    </span>
  );
}

/** Why a run has no result, for `RunState`. */
export function unevaluated(run: Run): string | undefined {
  if (run.evaluation !== "missing") return undefined;
  return run.evaluation_problem === "" ? "the service ended before it was evaluated" : run.evaluation_problem;
}
