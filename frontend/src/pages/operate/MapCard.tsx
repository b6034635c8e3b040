/** Position and stiffness in one plane: what may be asked for, where the joint is and was; a click sets both references. */

import { useQuery } from "@tanstack/react-query";
import { type MouseEvent, useMemo } from "react";
import { useCanvas } from "../../charts/useCanvas";
import { Card } from "../../components/Card";
import { Refusal } from "../../components/Refusal";
import { useLive, useLiveStore } from "../../live/react";
import { useSetReferences } from "../../service/commands";
import { banksQuery } from "../../service/queries";
import styles from "./MapCard.module.css";
import { paintPlane } from "./paintPlane";
import { planeOver, pointAt } from "./planeScale";

const NO_ENTRIES: readonly number[] = [];

export function MapCard() {
  const store = useLiveStore();
  const send = useSetReferences();
  const bank = useLive((live) => live.state?.tuning.bank?.id);
  const banks = useQuery(banksQuery);
  const entries = useMemo(
    () => banks.data?.find(({ id }) => id === bank)?.entries.map(({ S_nominal }) => S_nominal) ?? NO_ENTRIES,
    [banks.data, bank],
  );
  const drawing = useMemo(() => {
    const newest = (name: string, decimals: number) => store.window.newest(name).toFixed(decimals);
    return {
      signature: () => {
        const { q_ref, S_ref } = store.snapshot().state?.references ?? {};
        return [newest("q", 2), newest("S", 2), q_ref, S_ref, ...entries].join();
      },
      paint: (surface: Parameters<typeof paintPlane>[0]) => {
        const state = store.snapshot().state;
        if (state !== null) paintPlane(surface, state.limits, state.references, store.window, entries);
      },
    };
  }, [store, entries]);
  const canvas = useCanvas(drawing);

  function aim(event: MouseEvent<HTMLCanvasElement>): void {
    const limits = store.snapshot().state?.limits;
    if (limits === undefined) return;
    const box = event.currentTarget.getBoundingClientRect();
    const plane = planeOver(limits, box.width, box.height);
    const { q, S } = pointAt(plane, event.clientX - box.left, event.clientY - box.top);
    send.mutate({ q_ref: q, S_ref: S });
  }

  return (
    <Card
      title="Reachable map"
      aside={<span className={styles.axes}>S [N·m/rad] over q [deg]</span>}
      className={styles.card}
    >
      <canvas ref={canvas} className={styles.map} role="img" aria-label="Reachable map" onClick={aim} />
      <Refusal
        text={send.error?.message}
        hint={`A click sets q_ref and S_ref together.${entries.length > 0 ? " ◆ entries of the bank." : ""}`}
      />
    </Card>
  );
}
