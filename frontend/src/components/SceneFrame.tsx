/** A 3D view of the service in a frame: STOP is heard in it too, and it leaves the page time to act. */

import { useEffect, useRef } from "react";
import { FramePacer, paceWindow } from "../charts/pacer";
import { useStop } from "../service/StopProvider";
import styles from "./SceneFrame.module.css";

/** Times the length of a slow 3D frame that is left to the loop and the charts. */
const REST = 4;

export function SceneFrame({ address, title }: { address: string; title: string }) {
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

  return <iframe key={address} ref={frame} src={address} title={title} className={styles.frame} />;
}
