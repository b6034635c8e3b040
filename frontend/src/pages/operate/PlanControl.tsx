/** What the references are followed by: a plan within a budget of voltage, or the governor of the paper. */

import { Switch } from "@mantine/core";
import { useEffect, useState } from "react";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { fixed } from "../../samples/format";
import { useAngles } from "../../service/angles";
import { fieldEntry } from "../../service/fieldHelp";
import { useSentValue } from "../../service/useSentValue";
import { useStanding } from "../../service/useStanding";
import type { Tuning } from "../../wire/types";
import styles from "./Operate.module.css";

const STEP_V = 0.1;
const DECIMALS = 1;

interface PlanControlProps {
  readonly tuning: Tuning;
  /** A run has the tuning: nothing of it is taken. */
  readonly disabled: boolean;
  /** What is in hand and not in force yet, for the forecast. */
  onDraft(u_plan: number | undefined): void;
  onCommit(u_plan: number): Promise<unknown>;
}

export function PlanControl({ tuning, disabled, onDraft, onCommit }: PlanControlProps) {
  const { u_plan, u_plan_min, u_plan_max, u_plan_usual } = tuning;
  const sent = useSentValue(u_plan, onCommit);
  const [problem, setProblem] = useState<string | null>(null);
  const refusal = problem === null ? sent.refusal : null;
  const refused = useStanding(refusal, u_plan) !== null;
  const planned = sent.value > 0;
  const angles = useAngles();
  const [typed, setTyped] = useState<number>();
  const drafted = typed ?? (sent.value === u_plan ? undefined : sent.value);

  // biome-ignore lint/correctness/useExhaustiveDependencies: only a new draft is news to the forecast
  useEffect(() => onDraft(drafted), [drafted]);

  return (
    <div className={styles.control}>
      <div className={styles.row}>
        <Switch
          size="xs"
          label="Follow a plan"
          checked={planned}
          disabled={disabled}
          onChange={(event) => sent.commit(event.currentTarget.checked ? u_plan_usual : 0)}
        />
        <span className={styles.bounds}>
          {planned
            ? `${fixed(u_plan_min, DECIMALS)} to ${fixed(u_plan_max, DECIMALS)} V`
            : "as in the paper: governor alone"}
        </span>
        {planned && (
          <ValueBox
            label="Budget of the plan [V]"
            unit="V"
            value={sent.value}
            decimals={DECIMALS}
            step={STEP_V}
            width={84}
            disabled={disabled}
            onDraft={setTyped}
            onCommit={sent.commit}
            onProblem={setProblem}
            saidAt="refusal-of-u_plan"
            entry={fieldEntry("tuning.u_plan", angles, { minimum: u_plan_min, maximum: u_plan_max })}
            refused={refused}
          />
        )}
      </div>
      <Refusal id="refusal-of-u_plan" error={refusal} about={u_plan} text={problem} />
    </div>
  );
}
