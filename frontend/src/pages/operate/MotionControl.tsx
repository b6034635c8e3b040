/** How references are followed: by the paper's law (lambda), or by a trajectory within a voltage limit (time-optimal). */

import { SegmentedControl } from "@mantine/core";
import { useState } from "react";
import { Explained } from "../../components/Explained";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { fixed } from "../../samples/format";
import { useAngles } from "../../service/angles";
import { useSetTuning } from "../../service/commands";
import { fieldEntry } from "../../service/fieldHelp";
import { useErrorLifetime } from "../../service/useErrorLifetime";
import { useSentValue } from "../../service/useSentValue";
import type { Tuning } from "../../wire/types";
import styles from "./Operate.module.css";

const STEP_V = 0.1;
const DECIMALS = 1;
const EFFECT = {
  lambda: "λ_q and λ_S set the speed of a step.",
  "time-optimal":
    "The voltage limit sets the speed of a step; λ sets robustness and the reaction to disturbances.",
} as const;
const MOTIONS = ["lambda", "time-optimal"] as const;

interface MotionControlProps {
  readonly tuning: Tuning;
  /** No change of the tuning is accepted now. */
  readonly disabled: boolean;
}

export function MotionControl({ tuning, disabled }: MotionControlProps) {
  const choose = useSetTuning();
  const { mutateAsync: setTuning } = useSetTuning();
  const motion = (choose.isPending && choose.variables.motion) || tuning.motion;
  const limit = useSentValue(tuning.u_plan, (u_plan) => setTuning({ motion: "time-optimal", u_plan }));
  const [problem, setProblem] = useState<string | null>(null);
  const refusal = problem === null ? (choose.error ?? limit.refusal) : null;
  const refused = useErrorLifetime(limit.refusal, tuning.u_plan) !== null;
  const angles = useAngles();
  const { u_plan_min, u_plan_max } = tuning;
  return (
    <div className={styles.control}>
      <div className={styles.row}>
        <Explained of="setting:tuning.motion">Motion</Explained>
        <SegmentedControl
          className={styles.motions}
          size="xs"
          aria-label="Motion"
          data={[...MOTIONS]}
          value={motion}
          disabled={disabled}
          onChange={(value) => {
            const chosen = MOTIONS.find((one) => one === value);
            if (chosen !== undefined) choose.mutate({ motion: chosen });
          }}
        />
      </div>
      {motion === "time-optimal" && (
        <div className={styles.limitRow}>
          <Explained of="setting:tuning.u_plan">Voltage limit</Explained>
          <ValueBox
            label="Voltage limit of time-optimal motion [V]"
            unit="V"
            value={limit.value}
            decimals={DECIMALS}
            step={STEP_V}
            width={124}
            disabled={disabled}
            onCommit={limit.commit}
            onProblem={setProblem}
            saidAt="refusal-of-u_plan"
            entry={fieldEntry("tuning.u_plan", angles, { minimum: u_plan_min, maximum: u_plan_max })}
            refused={refused}
          />
        </div>
      )}
      <Refusal
        id="refusal-of-u_plan"
        error={refusal}
        about={`${tuning.motion} ${tuning.u_plan}`}
        text={problem}
        hint={
          motion === "lambda"
            ? EFFECT.lambda
            : `${fixed(u_plan_min, DECIMALS)} to ${fixed(u_plan_max, DECIMALS)} V. ${EFFECT["time-optimal"]}`
        }
      />
    </div>
  );
}
