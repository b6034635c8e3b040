/** Touch: the outside force as the loop estimates it, what was learned of it, and the joint that gives way to contacts. */

import { Button } from "@mantine/core";
import { useEffect, useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive, useLiveStore } from "../../live/react";
import { fixed } from "../../samples/format";
import { useTouch } from "../../service/commands";
import { RefusedFields } from "../../service/refusedFields";
import type { State, TouchView } from "../../wire/types";
import styles from "./Operate.module.css";

const LOOK_MS = 100;
const USUAL_N = 2;

export function TouchCard() {
  const touch = useLive((live) => live.state?.touch);
  const limits = useLive((live) => live.state?.limits);
  return touch && limits ? <TouchControls touch={touch} limits={limits} /> : null;
}

function TouchControls({ touch, limits }: { touch: TouchView; limits: State["limits"] }) {
  const order = useTouch();
  const armed = touch.contact_N > 0;
  const [chosen, setChosen] = useState<number | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  const contact_N = chosen ?? (armed ? touch.contact_N : USUAL_N);
  const about = [contact_N, touch.learned.length];
  const refusal = problem === null ? order.error : null;
  return (
    <Card title="Touch" aside={<ForceNow touch={touch} />}>
      <RefusedFields error={refusal} about={about}>
        {/* biome-ignore lint/a11y/useSemanticElements: buttons that act at once are no form */}
        <div className={styles.touchRows} role="group" aria-label="Touch">
          <ValueBox
            label="Gives way from [N]"
            unit="N"
            value={contact_N}
            decimals={1}
            step={0.5}
            width={86}
            saidAt="refusal-of-touch"
            place="contact_N"
            onCommit={setChosen}
            onProblem={setProblem}
          />
          <Button
            size="compact-sm"
            variant="default"
            disabled={problem !== null || touch.learned.length === 0}
            onClick={() => order.mutate({ contact_N })}
          >
            {armed ? "Change" : "Give way"}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={!armed}
            onClick={() => order.mutate({ contact_N: 0 })}
          >
            Hold on
          </Button>
          <Button size="compact-sm" variant="default" onClick={() => order.mutate({ learn: true })}>
            Learn here
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={touch.learned.length === 0 || armed}
            onClick={() => order.mutate({ forget: true })}
          >
            Forget
          </Button>
        </div>
        <Refusal
          id="refusal-of-touch"
          error={refusal}
          about={about}
          forFields
          text={problem ?? told(touch)}
          hint={`${learned(touch)} Threshold ${fixed(limits.F_contact_min, 0)} … ${fixed(limits.F_contact_max, 0)} N.`}
        />
      </RefusedFields>
    </Card>
  );
}

/** By itself, as it changes ten times a second: the boxes beside it are not rendered for it. */
function ForceNow({ touch }: { touch: TouchView }) {
  return <span className={styles.bounds}>{reading(useForce(), touch)}</span>;
}

/** What stands out: a contact that is given way to, or that nothing is known yet. */
function told({ felt, contact_N }: TouchView): string | null {
  if (felt) {
    return `Contact: ${fixed(felt.F_ext_hat, 1)} N. The joint gives way; choose a mode to go on.`;
  }
  return contact_N > 0 ? `Gives way to contacts from ${fixed(contact_N, 1)} N on.` : null;
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
