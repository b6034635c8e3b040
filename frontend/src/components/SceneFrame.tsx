/** A 3D view of the service in a frame: it says what it waits for, STOP is heard in it, and it leaves the page time to act. */

import { Button } from "@mantine/core";
import { useEffect, useRef, useState } from "react";
import { canDrawSolid, paintsInSoftware } from "../drawing/canvas";
import { FramePacer, paceWindow } from "../drawing/pacer";
import { watchKeys } from "../stop/stop";
import styles from "./SceneFrame.module.css";
import { NO_3D, PATIENCE_S, type Stage, sceneWords, stageIn } from "./sceneStage";

/** Times the length of a slow 3D frame that is left to the loop and the charts. */
const REST = 4;

interface SceneFrameProps {
  /** With a query. */
  readonly address: string;
  readonly title: string;
}

export function SceneFrame({ address, title }: SceneFrameProps) {
  const [attempt, setAttempt] = useState(0);
  // an address of its own for each attempt: what the browser has kept of the one before may be what is wrong
  const asked = attempt === 0 ? address : `${address}&attempt=${attempt}`;
  // from another camera it is another page, which has to be listened to from its beginning
  return <View key={asked} address={asked} title={title} onAgain={() => setAttempt(attempt + 1)} />;
}

function View({ address, title, onAgain }: SceneFrameProps & { onAgain: () => void }) {
  const frame = useRef<HTMLIFrameElement>(null);
  const [stage, setStage] = useState<Stage>("page");
  const [late, setLate] = useState<Stage | null>(null);
  const [possible] = useState(canDrawSolid);

  useEffect(() => {
    const element = frame.current;
    if (element === null) return;
    let unwatch = () => {};
    const onMessage = (event: MessageEvent) => {
      if (event.source === element.contentWindow) setStage(stageIn(element));
    };
    const onLoad = () => {
      unwatch();
      const told = stageIn(element);
      setStage(told);
      if (told === "failed" || element.contentWindow === null) return;
      // keys pressed while the 3D view has the focus go to its own document: STOP has to listen there too
      unwatch = watchKeys(element.contentWindow);
      paceWindow(element.contentWindow, new FramePacer(REST));
    };
    window.addEventListener("message", onMessage);
    element.addEventListener("load", onLoad);
    return () => {
      window.removeEventListener("message", onMessage);
      element.removeEventListener("load", onLoad);
      unwatch();
    };
  }, []);

  useEffect(() => {
    setLate(null);
    const timer = window.setTimeout(() => setLate(stage), PATIENCE_S * 1000);
    return () => window.clearTimeout(timer);
  }, [stage]);

  const words = possible ? sceneWords(stage, late === stage, paintsInSoftware()) : NO_3D;
  const stuck = stage === "failed" || stage === "dropped" || (stage !== "shown" && late === stage);
  return (
    <div className={styles.frame}>
      <iframe ref={frame} src={address} title={title} className={styles.view} data-stage={stage} />
      <div className={styles.words} data-empty={words === ""}>
        {/* always there, so that a change of its words is heard */}
        <output aria-label={`${title} status`}>{words}</output>
        {possible && stuck && (
          <Button size="compact-xs" variant="default" onClick={onAgain}>
            Try again
          </Button>
        )}
      </div>
    </div>
  );
}
