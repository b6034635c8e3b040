/** Where a run will take the joint, in the plane of position and stiffness, with the joint as it is now. */

import { useMemo } from "react";
import { useCanvas } from "../../charts/useCanvas";
import { useLiveStore } from "../../live/react";
import { angleText, labelWith } from "../../samples/quantity";
import { useAngles } from "../../service/angles";
import type { Prediction } from "../../wire/types";
import { paintPlane } from "../operate/paintPlane";
import { useBankEntries } from "../operate/useBankEntries";
import page from "../Page.module.css";
import styles from "./Identify.module.css";

export function ForecastMap({ prediction }: { prediction: Prediction }) {
  const store = useLiveStore();
  const entries = useBankEntries();
  const angles = useAngles();
  const drawing = useMemo(() => {
    const newest = (name: string) => store.window.newest(name).toFixed(2);
    return {
      signature: () => [newest("q"), newest("S"), store.snapshot().state === null].join(),
      paint: (surface: Parameters<typeof paintPlane>[0]) => {
        const limits = store.snapshot().state?.limits;
        if (limits) paintPlane(surface, limits, undefined, store.window, entries, null, angles, prediction);
      },
    };
  }, [store, entries, prediction, angles]);
  const canvas = useCanvas(drawing);
  const [low, high] = [prediction.q_low, prediction.q_high].map((q) => angleText(q, 1, angles));
  return (
    <figure className={styles.map}>
      <canvas
        ref={canvas}
        role="img"
        aria-label={`Way of the joint, ${labelWith(`within ${low} to ${high}`, "rad", angles)}`}
      />
      <figcaption className={page.dim}>
        Way of the joint and the band it stays in: S [N·m/rad] over {labelWith("q", "rad", angles)}
      </figcaption>
    </figure>
  );
}
