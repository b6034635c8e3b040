/** Says what is wrong between this page's address and the service, and how to set it right: before anybody commands. */

import { useQuery } from "@tanstack/react-query";
import { useLive } from "../live/react";
import { capital } from "../samples/format";
import { addressCheckQuery, NO_STREAM } from "../service/api/system";
import styles from "./AddressProblems.module.css";
import { TEXTS } from "./texts";

/** The first connection is given up for lost after so many attempts, about two seconds. */
const ATTEMPTS = 3;

/** For a page that follows the live stream. */
export function AddressProblems() {
  const isWithoutStream = useLive(({ link }) => link.received_ms === null && link.failures >= ATTEMPTS);
  return <Problems isWithoutStream={isWithoutStream} />;
}

/** For a page without a live stream. */
export function Problems({ isWithoutStream = false }: { isWithoutStream?: boolean }) {
  const { data: way } = useQuery(addressCheckQuery(isWithoutStream));
  if (way === undefined) return null;
  const said = isWithoutStream && way.isAnswered ? [...way.problems, NO_STREAM] : way.problems;
  if (said.length === 0) return null;
  return (
    <div className={styles.problems} role="alert" aria-label={TEXTS.addressSetup}>
      {said.map((problem) => (
        <p key={problem}>
          <strong>{TEXTS.addressWrong}</strong> {capital(problem)}
        </p>
      ))}
      {!way.isAnswered && <p>{TEXTS.addressNoStop}</p>}
    </div>
  );
}
