/** The 3D view, served by the same service behind the same sign-in. */

import { useEffect, useRef } from "react";
import { FramePacer, paceWindow } from "../../charts/pacer";
import { Card } from "../../components/Card";
import { useStop } from "../../service/StopProvider";
import styles from "./Operate.module.css";

/** The view has to leave most of a slow machine to the loop and the charts. */
const REST = 4;

export function SceneCard() {
  const frame = useRef<HTMLIFrameElement>(null);
  const { watch } = useStop();

  // keys pressed while the 3D view has the focus go to its own document: STOP has to listen there too
  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    let unwatch = () => {};
    const onLoad = () => {
      unwatch();
      if (element.contentWindow === null) return;
      unwatch = watch(element.contentWindow);
      paceWindow(element.contentWindow, new FramePacer(REST));
    };
    element.addEventListener("load", onLoad);
    return () => {
      element.removeEventListener("load", onLoad);
      unwatch();
    };
  }, [watch]);

  return (
    <Card title="3D view" className={styles.scene}>
      <iframe ref={frame} src="./scene/" title="3D view" className={styles.sceneFrame} />
    </Card>
  );
}
