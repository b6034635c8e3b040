/** Card that adds an obstacle to a simulated plant and removes it, also while the joint moves. */

import { Button, NativeSelect } from "@mantine/core";
import { useState } from "react";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { ValueBox } from "../../components/ValueBox";
import { useLive } from "../../live/react";
import { angleWithUnit, FINER, rangeOf, readingOf, toSI } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useSetWall } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { useWhyNoControl } from "../../service/control/control";
import { isPlainRecord, useDraft } from "../../service/forms/drafts";
import { RefusedFields } from "../../service/forms/refusals";
import { fieldEntry } from "../../service/glossary";
import type { Limits, Wall } from "../../wire/types";
import styles from "./Operate.module.css";
import { TEXTS } from "./texts";

type Side = Wall["side"];

const SIDES: { value: Side; label: string }[] = [
  { value: "above", label: TEXTS.above },
  { value: "below", label: TEXTS.below },
];

/** Initial values of the boxes: an obstacle at 20°. */
const WALL: Wall = { q_wall: Math.PI / 9, side: "above", k_wall: 20000, c_wall: 1 };

function isWall(value: unknown): value is Wall {
  if (!isPlainRecord(value)) return false;
  const { q_wall, side, k_wall, c_wall } = value;
  return [q_wall, k_wall, c_wall].every(Number.isFinite) && (side === "above" || side === "below");
}

export function WallCard() {
  const simulated = useLive((live) => live.state?.plant.simulated ?? false);
  const { unit } = readingOf("rad", useAngleUnit());
  const limits = useLive((live) => live.state?.limits);
  return simulated && limits ? <WallControls key={unit} limits={limits} /> : null;
}

function WallControls({ limits }: { limits: Limits }) {
  const current = useLive((live) => live.state?.wall ?? null);
  const order = useSetWall();
  const noControl = useWhyNoControl();
  const angles = useAngleUnit();
  const stiffness = { minimum: limits.k_wall_min, maximum: limits.k_wall_max };
  const damping = { minimum: 0, maximum: limits.c_wall_max };
  const { unit, factor } = readingOf("rad", angles);
  const decimals = angles === "deg" ? 1 : 1 + FINER;
  const draft = useDraft<Wall>("wall", WALL, isWall);
  const { side, k_wall, c_wall } = draft.value;
  const q_wall = draft.value.q_wall * factor;
  const set = (part: Partial<Wall>) => draft.set((before) => ({ ...before, ...part }));
  const [problems, setProblems] = useState<readonly (string | null)[]>([null, null, null]);
  const problem = problems.find((one) => one !== null) ?? null;
  const refusal = problem === null ? order.error : null;
  const about = [q_wall, side, k_wall, c_wall];
  return (
    <Card
      title={TEXTS.wall}
      aside={
        <output id="told-of-wall" className={styles.bounds} data-stands={current !== null}>
          {current
            ? fillText(current.side === "above" ? TEXTS.wallAbove : TEXTS.wallBelow, {
                angle: angleWithUnit(current.q_wall, decimals, angles),
              })
            : TEXTS.simulatedOnly}
        </output>
      }
    >
      <RefusedFields error={refusal} about={about}>
        {/* biome-ignore lint/a11y/useSemanticElements: the buttons act at once; they are not a form */}
        <div className={styles.wallRow} role="group" aria-label={TEXTS.wall}>
          <span className={styles.wallLabel}>{TEXTS.sideAndAngle}</span>
          <NativeSelect
            aria-label={TEXTS.wallSide}
            value={side}
            onChange={(event) => set({ side: event.currentTarget.value as Side })}
            data={SIDES}
            w={84}
          />
          <ValueBox
            isInForm
            label={fillText(TEXTS.wallAngle, { unit })}
            unit={unit}
            value={q_wall}
            decimals={decimals}
            step={angles === "deg" ? 1 : 0.02}
            width={92}
            messageId="refusal-of-wall"
            place="wall.q_wall"
            entry={fieldEntry("wall.q_wall", angles)}
            onCommit={(angle) => set({ q_wall: toSI(angle, "rad", angles) })}
            onProblem={(found) => setProblems((before) => before.with(0, found))}
          />
          <span className={styles.wallLabel}>{TEXTS.stiffnessAndDamping}</span>
          <ValueBox
            isInForm
            label={TEXTS.wallStiffness}
            unit="N/m"
            value={k_wall}
            decimals={0}
            step={1000}
            width={104}
            messageId="refusal-of-wall"
            place="wall.k_wall"
            entry={fieldEntry("wall.k_wall", angles, stiffness)}
            onCommit={(k) => set({ k_wall: k })}
            onProblem={(found) => setProblems((before) => before.with(1, found))}
          />
          <ValueBox
            isInForm
            label={TEXTS.wallDamping}
            unit="s/m"
            value={c_wall}
            decimals={2}
            step={0.5}
            width={92}
            messageId="refusal-of-wall"
            place="wall.c_wall"
            entry={fieldEntry("wall.c_wall", angles, damping)}
            onCommit={(c) => set({ c_wall: c })}
            onProblem={(found) => setProblems((before) => before.with(2, found))}
          />
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null}
            onClick={() => {
              if (problem === null) order.mutate({ wall: draft.value });
            }}
          >
            {TEXTS.addWall}
          </Button>
          <Button
            size="compact-sm"
            variant="default"
            disabled={noControl !== null}
            onClick={() => order.mutate({ wall: null })}
          >
            {TEXTS.removeWall}
          </Button>
        </div>
        <Refusal
          id="refusal-of-wall"
          error={refusal}
          about={about}
          forFields
          text={problem ?? noControl}
          hint={bounds(limits)}
        />
      </RefusedFields>
    </Card>
  );
}

/** Returns the accepted stiffness and damping as text. */
function bounds({ k_wall_min, k_wall_max, c_wall_max }: Limits): string {
  return fillText(TEXTS.wallHint, {
    stiffness: rangeOf(k_wall_min, k_wall_max),
    damping: rangeOf(0, c_wall_max),
  });
}
