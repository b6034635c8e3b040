/** Map of position and stiffness with limits and trail; a click sets a target, a button sends it. */

import { Button } from "@mantine/core";
import { type MouseEvent, useMemo, useState } from "react";
import { useCanvas } from "../../charts/canvas";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { useLive, useLiveStore, useSampleAge } from "../../live/react";
import { age, fixed } from "../../samples/format";
import { angleWithUnit, FINER, labelWith, readingOf, toSI } from "../../samples/quantity";
import { fillText } from "../../samples/texts";
import { useReferenceOrders } from "../../service/api/actuator";
import { useAngleUnit } from "../../service/api/preferences";
import { useMayCommand, useWhyNoControl } from "../../service/control/control";
import type { References } from "../../wire/types";
import styles from "./MapCard.module.css";
import { type PlaneEntry, paintPlane, planeOver, pointAt } from "./operatingMap";
import { whyNoReferences } from "./ReferencesCard";
import { useBankEntries } from "./TuningCard";
import { TEXTS } from "./texts";

export function MapCard() {
  const store = useLiveStore();
  const send = useReferenceOrders();
  const angles = useAngleUnit();
  const [target, setTarget] = useState<References | null>(null);
  const references = useLive((live) => live.state?.references);
  const entries = useBankEntries();
  const drawing = useMemo(() => {
    const newest = (name: string, decimals: number) => store.window.newest(name).toFixed(decimals);
    return {
      signature: () => {
        const { q_ref, S_ref } = store.snapshot().state?.references ?? {};
        const aimed = [target?.q_ref, target?.S_ref];
        const points = entries.flatMap(({ S, q }) => [S, q]);
        return [newest("q", 2), newest("S", 2), q_ref, S_ref, ...aimed, ...points, angles].join();
      },
      paint: (surface: Parameters<typeof paintPlane>[0]) => {
        const state = store.snapshot().state;
        if (state !== null)
          paintPlane(surface, state.limits, state.references, store.window, entries, target, angles);
      },
    };
  }, [store, entries, target, angles]);
  const canvas = useCanvas(drawing);
  const old_s = useSampleAge();
  const plays = useLive((live) => Boolean(live.state?.player));
  const aims = useMayCommand() !== false && !plays;
  const noControl = useWhyNoControl();
  const locked = useLive((live) => whyNoReferences(live.state, noControl));

  function aim(event: MouseEvent<HTMLCanvasElement>): void {
    const limits = store.snapshot().state?.limits;
    if (limits === undefined) return;
    const box = event.currentTarget.getBoundingClientRect();
    const plane = planeOver(limits, box.width, box.height);
    const { q, S } = pointAt(plane, event.clientX - box.left, event.clientY - box.top);
    send.reset();
    const shown = rounded(q * readingOf("rad", angles).factor, angles === "deg" ? 1 : 1 + FINER);
    setTarget({ q_ref: toSI(shown, "rad", angles), S_ref: rounded(S, 2) });
  }

  function command(): void {
    if (target === null) return;
    send.mutate(target);
    setTarget(null);
  }

  return (
    <Card
      title={TEXTS.map}
      aside={
        <span className={styles.axes}>
          {old_s === null
            ? fillText(TEXTS.mapAxes, { position: labelWith("q", "rad", angles) })
            : fillText(TEXTS.mapOld, { age: age(1000 * old_s) })}
        </span>
      }
      className={styles.card}
    >
      <canvas
        ref={canvas}
        className={styles.map}
        data-stale={old_s !== null}
        role="img"
        aria-label={TEXTS.map}
        data-aims={aims}
        onClick={aims ? aim : undefined}
      />
      {target === null || !aims ? (
        <Refusal
          error={send.error}
          about={references}
          hint={`${aims ? TEXTS.mapHint : ""}${describeEntries(entries)}`}
        />
      ) : (
        // biome-ignore lint/a11y/useSemanticElements: the buttons act at once; they are not a form
        <div className={styles.target} role="group" aria-label={TEXTS.mapTarget}>
          <output>
            {fillText(TEXTS.mapTargetNotSent, {
              q_ref: angleWithUnit(target.q_ref, 1, angles),
              S_ref: fixed(target.S_ref, 2),
            })}
          </output>
          <Button size="compact-xs" disabled={locked !== null} title={locked ?? undefined} onClick={command}>
            {TEXTS.sendTarget}
          </Button>
          <Button size="compact-xs" variant="default" onClick={() => setTarget(null)}>
            {TEXTS.discardTarget}
          </Button>
        </div>
      )}
    </Card>
  );
}

function describeEntries(entries: readonly PlaneEntry[]): string {
  const known = entries.some(({ q }) => q !== null) ? ` ${TEXTS.mapEntries}` : "";
  const unknown = entries.some(({ q }) => q === null) ? ` ${TEXTS.mapEntriesOfS}` : "";
  return known + unknown;
}

/** Returns the value with the decimals that the card shows, so that the sent value equals the shown one. */
function rounded(value: number, decimals: number): number {
  return Number(value.toFixed(decimals));
}
