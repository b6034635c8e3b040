/** The actuator: flat, or in 3D by the same service behind the same sign-in. */

import { Button } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import { paintsInSoftware } from "../../charts/canvas";
import { FramePacer, paceWindow } from "../../charts/pacer";
import { Card } from "../../components/Card";
import { usePreferences } from "../../service/preferences";
import { useStop } from "../../service/StopProvider";
import { ActuatorDrawing } from "./ActuatorDrawing";
import styles from "./Operate.module.css";

/** Times the length of a slow 3D frame that is left to the loop and the charts. */
const REST = 4;

export function SceneCard() {
  // the 3D view shares this page's thread: without a graphics processor it would hold up STOP, so it is asked for there
  const { preferences, change } = usePreferences();
  const [here, setHere] = useState<boolean | null>(null);
  const solid = here ?? (!paintsInSoftware() && (preferences.solid ?? true));

  function toggle(): void {
    setHere(!solid);
    change({ solid: !solid });
  }
  return (
    <Card
      title="Actuator"
      className={styles.scene}
      aside={
        <Button
          size="compact-xs"
          variant="default"
          title={
            solid
              ? ""
              : "This browser paints without a graphics processor: the 3D view will slow this page down."
          }
          onClick={toggle}
        >
          {solid ? "Show flat" : "Show in 3D"}
        </Button>
      }
    >
      {solid ? <SceneFrame /> : <ActuatorDrawing />}
    </Card>
  );
}

function SceneFrame() {
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

  return <iframe ref={frame} src="./scene/" title="3D view" className={styles.sceneFrame} />;
}
