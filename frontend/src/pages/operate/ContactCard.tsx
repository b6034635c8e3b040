/** Touch: the outside force as the loop estimates it, what was learned of it, and the joint that gives way to contacts. */

import { Button } from "@mantine/core";
import { useEffect, useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive, useLiveStore } from "../../live/react";
import { fixed } from "../../samples/format";
import { rangeOf } from "../../samples/quantity";
import { useConfigureContact } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { useWhyNoControl } from "../../service/control/control";
import { useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { fieldEntry } from "../../service/glossary";
import type { State, TouchView } from "../../wire/types";
import styles from "./Operate.module.css";

const LOOK_MS = 100;
const USUAL_N = 2;
const NOT_IN_RUN = "Learned in run, where the joint is held";

function isNumber(value: unknown): value is number {
  return typeof value === "number";
}

export function ContactCard() {
  const touch = useLive((live) => live.state?.touch);
  const limits = useLive((live) => live.state?.limits);
  return touch && limits ? <TouchControls touch={touch} limits={limits} /> : null;
}

function TouchControls({ touch, limits }: { touch: TouchView; limits: State["limits"] }) {
  const order = useConfigureContact();
  const noControl = useWhyNoControl();
  const angles = useAngleUnit();
  const running = useLive((live) => live.state?.mode === "run");
  const rejects = useLive((live) => (live.state?.tuning.k_ext ?? 0) > 0);
  const armed = touch.contact_N > 0;
  const sweeping = touch.sweep?.under_way ?? false;
  const chosen = useDraft("threshold of contacts", armed ? touch.contact_N : USUAL_N, isNumber);
  const [problem, setProblem] = useState<string | null>(null);
  const contact_N = chosen.value;
  const about = [contact_N, touch.learned.length];
  const refusal = problem === null ? order.error : null;
  const now = told(touch);
  return (
    <Card title="Touch" aside={<ForceNow touch={touch} />}>
      <RefusedFields error={refusal} about={about}>
        {/* biome-ignore lint/a11y/useSemanticElements: buttons that act at once are no form */}
        <div className={styles.touchRows} role="group" aria-label="Touch">
          <ValueBox
            isInForm
            label="Gives way from [N]"
            unit="N"
            value={contact_N}
            decimals={1}
            step={0.5}
            width={86}
            messageId="refusal-of-touch"
            place="contact_N"
            entry={fieldEntry("touch.contact_N", angles, {
              minimum: limits.F_contact_min,
              maximum: limits.F_contact_max,
            })}
            onCommit={chosen.set}
            onProblem={setProblem}
          />
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || problem !== null || touch.learned.length === 0 || sweeping}
            onClick={() => order.mutate({ contact_N })}
          >
            {armed ? "Change" : "Give way"}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || !armed}
            onClick={() => order.mutate({ contact_N: 0 })}
          >
            Hold on
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || sweeping || !running}
            title={running ? "At rest, with nothing touching the joint" : NOT_IN_RUN}
            onClick={() => order.mutate({ learn: true })}
          >
            Learn here
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || armed || !(running || sweeping)}
            title={running || sweeping ? "At five stiffnesses, one after the other" : NOT_IN_RUN}
            onClick={() => order.mutate({ sweep: sweeping ? "stop" : "begin" })}
          >
            {sweeping ? "Stop learning" : "Learn over S"}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null || touch.learned.length === 0 || armed || sweeping || rejects}
            title={rejects ? "Pushes are rejected by what was learned: turn that off first" : undefined}
            onClick={() => order.mutate({ forget: true })}
          >
            Forget
          </Button>
        </div>
        <output id="told-of-touch" className={styles.touchNow} data-matters={now !== null}>
          {now ?? learned(touch)}
        </output>
        <Refusal
          id="refusal-of-touch"
          error={refusal}
          about={about}
          forFields
          text={problem ?? noControl}
          hint={`Threshold ${rangeOf(limits.F_contact_min, limits.F_contact_max)} N.`}
        />
        <Learned points={touch.learned} />
      </RefusedFields>
    </Card>
  );
}

/** What was learned at each stiffness, and how quiet the estimate is there. */
function Learned({ points }: { points: TouchView["learned"] }) {
  if (points.length === 0) return null;
  return (
    <table className={styles.learned} aria-label="Learned of the outside force">
      <thead>
        <tr>
          <th scope="col">S [N·m/rad]</th>
          <th scope="col">reads [N]</th>
          <th scope="col">± [N]</th>
        </tr>
      </thead>
      <tbody>
        {points.map(({ S, F, std_N }) => (
          <tr key={S}>
            <th scope="row">{fixed(S, 1)}</th>
            <td>{fixed(F, 2)}</td>
            <td>{fixed(std_N, 2)}</td>
          </tr>
        ))}
      </tbody>
    </table>
  );
}

/** By itself, as it changes ten times a second: the boxes beside it are not rendered for it. */
function ForceNow({ touch }: { touch: TouchView }) {
  return <span className={styles.bounds}>{reading(useForce(), touch)}</span>;
}

/** What stands out: a contact that is given way to, how far learning over S is, or why it ended before its end. */
function told({ felt, contact_N, sweep }: TouchView): string | null {
  if (felt) {
    return `Contact: ${fixed(felt.F_ext_hat, 1)} N. The joint gives way; choose a mode to go on.`;
  }
  if (contact_N > 0) return `Gives way to contacts from ${fixed(contact_N, 1)} N on.`;
  if (!sweep?.under_way && !sweep?.why) return null;
  const at = `${sweep.point} of ${sweep.points}: ${fixed(sweep.S_ref, 1)} N·m/rad`;
  if (sweep.under_way) return `Learning over S, ${at}. Keep away from the joint.`;
  return `Learning over S ended at ${at}. The reason: ${sweep.why}.`;
}

/** At which stiffnesses it is known what is estimated with nothing outside. */
function learned({ learned: points }: TouchView): string {
  if (points.length === 0) return "Nothing learned: let go of the joint at rest, and learn there.";
  return `Learned at ${points.map((point) => fixed(point.S, 1)).join(", ")} N·m/rad.`;
}

/** The outside force with its standard deviation at rest, as far as that was learned. */
function reading(force: number, { learned: points }: TouchView): string {
  if (!Number.isFinite(force)) return "outside force not known before pretension";
  const spread = Math.max(0, ...points.map((point) => point.std_N));
  return `F_ext ${fixed(force, 1)}${points.length ? ` ± ${fixed(spread, 2)}` : ""} N`;
}

/** The outside force now [N], to a tenth, nan where it is not known. Only a change of it renders anew. */
function useForce(): number {
  const store = useLiveStore();
  const [force, setForce] = useState(Number.NaN);
  useEffect(() => {
    const timer = window.setInterval(
      () => setForce(Math.round(10 * store.window.newest("F_ext_hat")) / 10),
      LOOK_MS,
    );
    return () => window.clearInterval(timer);
  }, [store]);
  return force;
}
