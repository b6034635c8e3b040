/** Card that pushes a simulated joint for a set time; the control loop then releases the push. */

import { Button } from "@mantine/core";
import { useEffect, useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive, useLiveStore } from "../../live/react";
import { fixed } from "../../samples/format";
import { rangeOf } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { usePush } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { useWhyNoControl } from "../../service/control/control";
import { isPlainRecord, useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { fieldEntry } from "../../service/glossary";
import type { State } from "../../wire/types";
import styles from "./Operate.module.css";
import { TEXTS } from "./texts";

const LONGEST_S = 10;
const POLL_MS = 100;
const PUSH = { F_push: 10, duration_s: 2 };

function isPush(value: unknown): value is typeof PUSH {
  return isPlainRecord(value) && typeof value.F_push === "number" && typeof value.duration_s === "number";
}

export function DisturbanceCard() {
  const F_push_max = useLive((live) => live.state?.limits.F_push_max ?? 0);
  return F_push_max > 0 ? <PushControls F_push_max={F_push_max} /> : null;
}

function PushControls({ F_push_max }: { F_push_max: number }) {
  const mode = useLive((live) => live.state?.mode);
  const angles = useAngleUnit();
  const force = { minimum: -F_push_max, maximum: F_push_max };
  const applied_N = useAppliedPush();
  const push = usePush();
  const draft = useDraft("push", PUSH, isPush);
  const { F_push, duration_s } = draft.value;
  const [problems, setProblems] = useState<readonly (string | null)[]>([null, null]);
  const noControl = useWhyNoControl();
  const reason = noControl ?? whyNoPush(mode);
  const problem = problems.find((one) => one !== null) ?? null;
  const refusal = problem === null && reason === null ? push.error : null;
  const about = [F_push, duration_s];
  return (
    <Card title={TEXTS.push} aside={<span className={styles.bounds}>{TEXTS.simulatedOnly}</span>}>
      <RefusedFields error={refusal} about={about}>
        {/* biome-ignore lint/a11y/useSemanticElements: the buttons act at once; they are not a form */}
        <div className={styles.pushRow} role="group" aria-label={TEXTS.push}>
          <ValueBox
            isInForm
            label={TEXTS.pushForce}
            unit="N"
            value={F_push}
            decimals={1}
            step={1}
            width={86}
            messageId="refusal-of-push"
            place="F_push"
            entry={fieldEntry("push.F_push", angles, force)}
            onCommit={(force_N) => draft.set((before) => ({ ...before, F_push: force_N }))}
            onProblem={(found) => setProblems((before) => before.with(0, found))}
          />
          <ValueBox
            isInForm
            label={TEXTS.pushDuration}
            unit="s"
            value={duration_s}
            decimals={1}
            step={0.5}
            width={72}
            messageId="refusal-of-push"
            place="duration_s"
            entry={fieldEntry("push.duration_s", angles, { minimum: 0, maximum: LONGEST_S })}
            onCommit={(time_s) => draft.set((before) => ({ ...before, duration_s: time_s }))}
            onProblem={(found) => setProblems((before) => before.with(1, found))}
          />
          <Button
            size="compact-sm"
            variant="default"
            aria-disabled={reason !== null}
            data-disabled={reason !== null || undefined}
            onClick={(event) => {
              if (reason === null && problem === null) push.mutate({ F_push, duration_s });
              else event.preventDefault();
            }}
          >
            {TEXTS.applyPush}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null}
            onClick={() => push.mutate({ F_push: 0, duration_s: 0 })}
          >
            {TEXTS.release}
          </Button>
        </div>
        <Refusal
          id="refusal-of-push"
          error={refusal}
          about={about}
          forFields
          text={
            problem ?? (applied_N !== 0 ? fillText(TEXTS.pushing, { force: fixed(applied_N, 1) }) : reason)
          }
          hint={fillText(TEXTS.pushHint, { range: rangeOf(-F_push_max, F_push_max), time: LONGEST_S })}
        />
      </RefusedFields>
    </Card>
  );
}

/** Returns the applied push [N], rounded to 0.1 N so that small changes do not render; 0 without one. */
function useAppliedPush(): number {
  const store = useLiveStore();
  const [applied_N, setApplied] = useState(0);
  useEffect(() => {
    const timer = window.setInterval(() => {
      const newest = store.window.newest("F_push");
      setApplied(Number.isFinite(newest) ? Math.round(10 * newest) / 10 : 0);
    }, POLL_MS);
    return () => window.clearInterval(timer);
  }, [store]);
  return applied_N;
}

/** Returns the reason why the joint cannot be pushed now; null if it can. */
function whyNoPush(mode: State["mode"] | undefined): string | null {
  return mode === "run" || mode === "compliance" ? null : TEXTS.pushNeedsMode;
}
