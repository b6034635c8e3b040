/** In place of the controls, for those who look on: what is in force, as numbers that cannot be changed. */

import { Card } from "../../components/Card";
import { useLive } from "../../live/react";
import { fixed } from "../../samples/format";
import { angleWithUnit } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import { motionInWords } from "../../service/tuningWords";
import page from "../Page.module.css";

export function ViewOnly() {
  const angles = useAngles();
  const state = useLive((live) => live.state);
  if (state === null) return null;
  const { references, tuning } = state;
  return (
    <Card title="In force">
      <dl className={page.facts}>
        <dt>{references.in_force ? "Position reference" : "Position, without reference"}</dt>
        <dd>{angleWithUnit(references.q_ref, 1, angles)}</dd>
        <dt>{references.in_force ? "Stiffness reference" : "Stiffness, without reference"}</dt>
        <dd>{references.S_ref === null ? "slack: none" : `${fixed(references.S_ref, 2)} N·m/rad`}</dd>
        <dt>λ_q, λ_S, λ_motor</dt>
        <dd>
          {fixed(tuning.lam_q, 3)}, {fixed(tuning.lam_S, 3)}, {fixed(tuning.lam_motor, 4)} s
        </dd>
        <dt>Motion</dt>
        <dd>{motionInWords(tuning.motion, tuning.u_plan)}</dd>
        <dt>Pushes</dt>
        <dd>{tuning.k_ext > 0 ? `rejected by ${fixed(tuning.k_ext, 2)}` : "left to the position loop"}</dd>
        <dt>Gains</dt>
        <dd>{tuning.bank === null ? "from geometry" : `bank ${tuning.bank.name} v${tuning.bank.version}`}</dd>
      </dl>
      <p className={page.dim}>You are signed in as a viewer: you may look at everything and press STOP.</p>
    </Card>
  );
}
